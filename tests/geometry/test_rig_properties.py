import numpy as np
from hypothesis import given, settings
from numpy.testing import assert_allclose
from rig_strategies import angles, axes, pixels, rigs

from app.geometry.arrays import Floats
from app.geometry.axis import TurntableAxis
from app.geometry.rig import Rig, Triangulator


@given(axes())
def test_the_table_frame_stands_on_the_axis_and_looks_at_the_camera(axis: TurntableAxis) -> None:
    frame = axis.camera_from_table
    assert_allclose(frame.rotation.T @ frame.rotation, np.eye(3), atol=1e-12)
    assert_allclose(np.linalg.det(frame.rotation), 1.0)
    assert_allclose(frame.rotation[:, 2], axis.direction, atol=1e-12)
    camera = (frame.inverse() @ np.zeros((1, 3)))[0]
    assert camera[0] > 0.0
    assert_allclose(camera[1], 0.0, atol=1e-9)


@given(axes(), angles)
def test_a_point_of_the_axis_stays_where_it_is(axis: TurntableAxis, angle: float) -> None:
    on_axis = axis.point_mm + np.outer([-30.0, 0.0, 55.0], axis.direction)
    assert_allclose(axis.table_from_camera(angle) @ on_axis, axis.table_from_camera(0.0) @ on_axis, atol=1e-9)


@given(rigs(), pixels(), angles)
def test_a_triangulated_pixel_projects_back_to_itself(rig: Rig, seen: Floats, angle: float) -> None:
    points = rig.triangulate(seen, "laser", angle)
    known = np.isfinite(points).all(axis=1)
    in_camera = rig.axis.table_from_camera(angle).inverse() @ points[known]
    assert_allclose(rig.camera.project(in_camera), seen[known], atol=1e-6)


@settings(max_examples=10)
@given(rigs(), pixels(), angles)
def test_the_fast_triangulation_agrees_with_the_plain_one(rig: Rig, seen: Floats, angle: float) -> None:
    plain = rig.triangulate(seen, "laser", angle)
    fast = Triangulator.of(rig).points(seen, "laser", angle)
    near = np.linalg.norm(np.nan_to_num(plain, nan=1e9), axis=1) < 500.0
    # Where the sheet is seen edge on, float32 tells less.
    per_pixel = rig.depth_per_pixel(seen[near], "laser", (1.0, 0.0))
    off = np.linalg.norm(fast[near] - plain[near], axis=1)
    assert (off <= 2e-3 * np.maximum(per_pixel, 0.25)).all()


@given(rigs(), pixels(), angles)
def test_turning_the_table_turns_the_points_about_its_axis(rig: Rig, seen: Floats, angle: float) -> None:
    still, turned = rig.triangulate(seen, "laser", 0.0), rig.triangulate(seen, "laser", angle)
    known = np.isfinite(still).all(axis=1) & (np.linalg.norm(still, axis=1) < 1e4)
    assert_allclose(turned[known, 2], still[known, 2], atol=1e-8)
    heading = np.exp(1j * -angle) * (still[known, 0] + 1j * still[known, 1])
    assert_allclose(turned[known, 0] + 1j * turned[known, 1], heading, atol=1e-7)
