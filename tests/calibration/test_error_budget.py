"""What the uncertainty of a calibration does at the object."""

from dataclasses import replace

import numpy as np

from app.calibration.error_budget import object_pixels
from app.geometry.plane import LaserPlane
from app.geometry.rig import Rig
from benchmarks.synthetic_views import surface_error_mm, typical_rig


def test_the_object_is_a_cylinder_about_the_axis_that_the_camera_sees() -> None:
    rig = typical_rig(2)
    for laser in rig.lasers:
        pixels = object_pixels(rig, laser, 40.0)
        assert len(pixels) > 5
        points = rig.triangulate(pixels, laser, 0.0)
        np.testing.assert_allclose(np.hypot(points[:, 0], points[:, 1]), 40.0, atol=1e-6)
        assert ((pixels >= 0.0) & (pixels <= [1279.0, 719.0])).all()


def test_a_laser_that_misses_the_object_lights_none_of_it() -> None:
    rig = typical_rig()
    plane = rig.lasers["left"]
    aside = LaserPlane(plane.normal, plane.distance_mm + 80.0)
    assert len(object_pixels(Rig(rig.camera, {"left": aside}, rig.axis), "left")) == 0


def test_a_laser_across_the_axis_lights_no_cylinder() -> None:
    rig = typical_rig()
    lying = LaserPlane.through(rig.axis.origin, rig.axis.direction)
    assert len(object_pixels(Rig(rig.camera, {"left": lying}, rig.axis), "left")) == 0


def test_a_perfect_calibration_leaves_no_surface_error_and_a_shifted_plane_does() -> None:
    rig = typical_rig()
    assert surface_error_mm(rig, rig) < 1e-9
    plane = rig.lasers["left"]
    shifted = replace(rig, lasers={"left": LaserPlane(plane.normal, plane.distance_mm + 0.1)})
    assert 0.01 < surface_error_mm(rig, shifted) < 0.3
