import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from rig_strategies import angles

from app.geometry.arrays import Floats
from app.geometry.axis import TurntableAxis
from app.geometry.camera import CameraIntrinsics
from app.geometry.platter import SeenMarkers, angle_from_markers, solve_layout

CAMERA = CameraIntrinsics(
    np.array([[620.0, 0.0, 323.0], [0.0, 619.0, 239.0], [0.0, 0.0, 1.0]]),
    np.array([0.12, -0.22, -0.001, -0.002, 0.0]),
    (640, 480),
)
AXIS = TurntableAxis(np.array([13.0, 56.0, 415.0]), np.array([0.038, -0.924, -0.380]) / 0.9998, 0.0)


def layout(height_mm: float = 0.0) -> dict[int, Floats]:
    square = np.array([[-15.0, 15.0, 0.0], [15.0, 15.0, 0.0], [15.0, -15.0, 0.0], [-15.0, -15.0, 0.0]])
    places = {5: (-2.0, -75.0), 18: (-70.0, 6.0), 27: (79.0, -7.0), 42: (11.0, 74.0)}
    return {number: square + np.array([x, y, height_mm]) for number, (x, y) in places.items()}


def seen_at(angle: float, noise_px: float = 0.0, seed: int = 0, height_mm: float = 0.0) -> SeenMarkers:
    rng = np.random.default_rng(seed)
    camera_from_table = AXIS.table_from_camera(angle).inverse()
    return {
        number: CAMERA.project(camera_from_table @ corners) + rng.normal(0.0, noise_px, (4, 2))
        for number, corners in layout(height_mm).items()
    }


def apart(a: float, b: float) -> float:
    return abs(float(np.angle(np.exp(1j * (a - b)))))


@given(angles)
def test_markers_tell_the_angle(angle: float) -> None:
    found = angle_from_markers(CAMERA, AXIS, layout(), seen_at(angle))
    assert apart(found.angle_rad, angle) < 1e-7
    assert found.rms_px < 1e-4


@given(angles, st.sampled_from([5, 18, 27, 42]))
def test_a_single_marker_is_enough(angle: float, number: int) -> None:
    seen = {number: seen_at(angle)[number]}
    assert apart(angle_from_markers(CAMERA, AXIS, layout(), seen).angle_rad, angle) < 1e-6


@given(angles)
def test_a_marker_that_was_moved_hardly_turns_the_angle(angle: float) -> None:
    seen = dict(seen_at(angle, 0.1))
    seen[18] = seen[18] + np.array([25.0, -12.0])
    found = angle_from_markers(CAMERA, AXIS, layout(), seen)
    assert apart(found.angle_rad, angle) < np.radians(0.15)


def test_corner_noise_of_a_tenth_of_a_pixel_leaves_hundredths_of_a_degree() -> None:
    turns = np.linspace(-3.0, 3.0, 40)
    off = [
        apart(angle_from_markers(CAMERA, AXIS, layout(), seen_at(t, 0.1, k)).angle_rad, t)
        for k, t in enumerate(turns)
    ]
    assert np.degrees(np.sqrt(np.mean(np.square(off)))) < 0.02


def test_unknown_markers_tell_nothing() -> None:
    found = angle_from_markers(CAMERA, AXIS, layout(), {99: seen_at(0.0)[5]})
    assert np.isnan(found.angle_rad)
    assert np.isnan(angle_from_markers(CAMERA, AXIS, layout(), {}).angle_rad)


@settings(max_examples=5)
@given(st.integers(0, 100), st.floats(-20.0, 5.0))
def test_the_layout_comes_out_of_one_turn_although_steps_were_lost(seed: int, height_mm: float) -> None:
    told = np.radians(np.arange(0.0, 360.0, 9.0))
    true = told - np.radians(np.where(np.arange(len(told)) < 12, 1.8, 0.0))
    views = [seen_at(t, 0.1, seed + k, height_mm) for k, t in enumerate(true)]
    fit = solve_layout(CAMERA, AXIS, views, told)
    assert_allclose(np.degrees(fit.angles_rad - true), 0.0, atol=0.06)
    for number, corners in layout(height_mm).items():
        assert_allclose(fit.layout[number], corners, atol=0.25)
    assert fit.rms_px < 0.2


def test_a_picture_without_markers_has_no_angle_in_the_layout() -> None:
    told = np.radians(np.arange(0.0, 360.0, 20.0))
    views = [seen_at(t, 0.05, k) for k, t in enumerate(told)]
    views[4] = {}
    fit = solve_layout(CAMERA, AXIS, views, told)
    assert np.isnan(fit.angles_rad[4])
    assert np.isfinite(np.delete(fit.angles_rad, 4)).all()


def test_two_angles_are_too_few_for_a_layout() -> None:
    with pytest.raises(ValueError, match="three different angles"):
        solve_layout(CAMERA, AXIS, [seen_at(0.0), seen_at(0.1)], np.array([0.0, 0.1]))
