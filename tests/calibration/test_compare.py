"""What has changed between two calibrations, against changes that are known."""

import json
from dataclasses import replace

import numpy as np
import pytest

from app.calibration.compare import compare
from app.calibration.record import CalibrationRecord
from app.errors import CalibrationFileError
from app.geometry.axis import TurntableAxis
from app.geometry.camera import CameraIntrinsics
from app.geometry.plane import LaserPlane
from app.geometry.rig import Rig
from app.geometry.transform import rotation_about
from app.simulation.rig import standard_rig

RIG = standard_rig().rig


def record(rig: Rig = RIG) -> CalibrationRecord:
    return CalibrationRecord(camera=rig.camera, lasers=rig.lasers, axis=rig.axis, source="it")


def with_axis(axis: TurntableAxis) -> Rig:
    return replace(RIG, axis=axis)


def test_a_calibration_does_not_differ_from_itself() -> None:
    same = compare(record(), record())
    assert same.camera.focal_px == (0.0, 0.0)
    assert same.camera.edge_px == same.camera.centre_px == same.camera.focal_percent == 0.0
    assert same.axis is not None
    assert same.axis.shift_mm < 1e-10
    assert same.axis.table_mm == same.axis.tilt_deg == 0.0
    for change in same.ball.values():
        assert change.points > 30
        assert change.moved_mm == 0.0
        assert change.bent_mm < 1e-10
    assert same.bent_mm < 1e-10


def test_the_camera_s_changes_are_in_pixels() -> None:
    matrix = RIG.camera.matrix + np.diag([14.0, 14.025, 0.0])
    matrix[:2, 2] += [3.0, -4.0]
    change = compare(record(), record(replace(RIG, camera=replace(RIG.camera, matrix=matrix)))).camera
    assert change.focal_px == pytest.approx((14.0, 14.025))
    assert change.focal_percent == pytest.approx(1.0)
    assert change.centre_px == pytest.approx(5.0)


def test_distortion_is_compared_at_the_edge_of_the_picture() -> None:
    straight = CameraIntrinsics(
        np.array([[1000.0, 0.0, 500.0], [0.0, 1000.0, 400.0], [0.0, 0.0, 1.0]]), np.zeros(5), (1001, 801)
    )
    bent = replace(straight, distortion=np.array([0.1, 0.0, 0.0, 0.0, 0.0]))
    first, second = CalibrationRecord(camera=straight), CalibrationRecord(camera=bent)
    # Most at the corners, where r^2 = 0.5^2 + 0.4^2.
    assert compare(first, second).camera.edge_px == pytest.approx(100.0 * 0.41**1.5)
    assert compare(first, second).axis is None
    assert np.isnan(compare(first, second).bent_mm)


@pytest.mark.parametrize("shift_mm", [0.25, -0.25])
def test_a_plane_is_compared_where_it_passes_the_axis(shift_mm: float) -> None:
    old = RIG.lasers["left"]
    turned = rotation_about(RIG.axis.direction, np.radians(0.3))
    near_axis = RIG.axis.origin + 30.0 * RIG.axis.direction
    foot = near_axis - old.signed_distance(near_axis[None])[0] * old.normal
    new = LaserPlane.through(foot - shift_mm * (turned @ old.normal), turned @ old.normal)
    changed = compare(record(), record(replace(RIG, lasers={**RIG.lasers, "left": new})))
    lean = abs(float(old.normal @ RIG.axis.direction))
    assert changed.lasers["left"].angle_deg == pytest.approx(0.3 * np.sqrt(1.0 - lean**2), rel=1e-4)
    assert changed.lasers["left"].at_axis_mm == pytest.approx(shift_mm)
    assert changed.lasers["right"].angle_deg == changed.lasers["right"].at_axis_mm == 0.0
    # One laser has moved against the other: no laying onto each other takes that away.
    assert changed.ball["right"].moved_mm == 0.0
    assert changed.ball["left"].bent_mm > 0.05


def test_axes_are_compared_at_the_object() -> None:
    axis = RIG.axis
    across = np.cross(axis.direction, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across)
    middle = axis.origin + 30.0 * axis.direction
    tilted = rotation_about(across, np.radians(0.2)) @ axis.direction
    moved = TurntableAxis(middle + 0.4 * across + 100.0 * tilted, tilted, -130.0 + 0.7)
    change = compare(record(), record(with_axis(moved))).axis
    assert change is not None
    assert change.shift_mm == pytest.approx(0.4)
    assert change.tilt_deg == pytest.approx(0.2)
    assert change.table_mm == pytest.approx(0.7, abs=1e-3)


def test_a_table_that_is_higher_moves_a_scan_and_does_not_bend_it() -> None:
    higher = compare(record(), record(with_axis(replace(RIG.axis, offset_mm=RIG.axis.offset_mm + 2.0))))
    for change in higher.ball.values():
        assert change.moved_mm == pytest.approx(2.0, abs=0.02)
        assert change.bent_mm < 1e-9


def test_an_axis_aside_bends_a_scan() -> None:
    aside = TurntableAxis(
        RIG.axis.point_mm + np.array([0.5, 0.0, 0.0]), RIG.axis.direction, RIG.axis.offset_mm
    )
    bent = compare(record(), record(with_axis(aside)))
    assert 0.3 < bent.bent_mm < 0.6


def test_a_rig_of_another_size_bends_in_proportion() -> None:
    """Everything 1 % larger: a ball of radius 30 mm about the axis grows by 0.3 mm."""
    axis = replace(RIG.axis, point_mm=1.01 * RIG.axis.point_mm, offset_mm=1.01 * RIG.axis.offset_mm)
    planes = {n: replace(p, distance_mm=1.01 * p.distance_mm) for n, p in RIG.lasers.items()}
    change = compare(record(), record(Rig(RIG.camera, planes, axis)))
    # The ball stands on the table, and laid onto the other it grows about its middle.
    for ball in change.ball.values():
        assert 0.2 < ball.bent_mm < 0.31


def test_the_same_rig_in_turned_pictures_is_refused() -> None:
    other = record(standard_rig(720, 1280).rig)
    with pytest.raises(CalibrationFileError, match="it: is for pictures of 720 x 1280, and the other"):
        compare(record(), other)


def test_lasers_that_only_one_knows_are_named() -> None:
    left = replace(RIG, lasers={"left": RIG.lasers["left"]})
    right = replace(RIG, lasers={"right": RIG.lasers["right"]})
    change = compare(record(left), record(right))
    assert (change.only_first, change.only_second) == (("left",), ("right",))
    assert not change.lasers
    assert not change.ball


def test_without_a_table_the_shape_is_compared_all_the_same() -> None:
    unknown = replace(RIG.axis, offset_mm=float("nan"))
    change = compare(record(), record(with_axis(unknown)))
    assert change.axis is not None
    assert np.isnan(change.axis.table_mm)
    assert set(change.ball) == {"left", "right"}
    assert change.bent_mm < 1e-9
    assert json.loads(json.dumps(change.as_json(), allow_nan=False))["axis"]["table_mm"] is None


def test_a_laser_that_misses_the_ball_is_left_out() -> None:
    aside = LaserPlane(RIG.lasers["left"].normal, RIG.lasers["left"].distance_mm + 40.0)
    off = record(replace(RIG, lasers={**RIG.lasers, "left": aside}))
    assert set(compare(off, off).ball) == {"right"}
