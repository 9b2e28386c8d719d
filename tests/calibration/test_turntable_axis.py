"""The axis in closed form."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from app.calibration.turntable_axis import solve_axis_line, solve_axis_turning
from app.errors import CalibrationError
from app.geometry.arrays import Floats, Points, Vector3
from app.geometry.transform import RigidTransform, rotation_about, rotation_from_rvec

POINT = np.array([4.0, 20.0, 310.0])
UP = np.array([0.05, -0.9, -0.4]) / np.linalg.norm([0.05, -0.9, -0.4])


def turned(angles_deg: Floats, seed: int = 0, noise_mm: float = 0.0) -> list[RigidTransform]:
    rng = np.random.default_rng(seed)
    start = RigidTransform(rotation_from_rvec(rng.normal(size=3)), POINT + rng.normal(size=3) * 30.0)
    poses = []
    for angle in np.radians(angles_deg):
        turn = rotation_about(UP, angle)
        place = turn @ (start.translation - POINT) + POINT + rng.normal(size=3) * noise_mm
        poses.append(RigidTransform(turn @ start.rotation, place))
    return poses


def distance_to_axis(point: Vector3) -> float:
    return float(np.linalg.norm(np.cross(point - POINT, UP)))


ANGLES_DEG = np.array([-30.0, -10.0, 0.0, 15.0, 40.0])


def test_a_board_that_turns_gives_the_axis() -> None:
    found = solve_axis_turning([turned(ANGLES_DEG)], [np.radians(ANGLES_DEG)])
    assert_allclose(found.axis.direction, UP, atol=1e-9)
    assert distance_to_axis(found.axis.point_mm) < 1e-6
    assert found.rms_mm < 1e-6
    assert np.isnan(found.axis.offset_mm)
    assert found.warnings == ()


def test_two_placements_are_better_than_one() -> None:
    one = solve_axis_turning([turned(ANGLES_DEG, 1, 0.2)], [np.radians(ANGLES_DEG)])
    two = solve_axis_turning(
        [turned(ANGLES_DEG, 1, 0.2), turned(ANGLES_DEG, 2, 0.2)], [np.radians(ANGLES_DEG)] * 2
    )
    assert distance_to_axis(one.axis.point_mm) < 1.0
    assert distance_to_axis(two.axis.point_mm) < 1.0
    assert len(two.view_mm) == 10
    assert 0.05 < two.rms_mm < 0.6


def test_angles_tell_which_way_is_up() -> None:
    found = solve_axis_turning([turned(-ANGLES_DEG)], [np.radians(ANGLES_DEG)])
    assert_allclose(found.axis.direction, -UP, atol=1e-9)
    assert any("turntable.direction" in text for text in found.warnings)


def test_without_angles_up_is_up_in_the_picture() -> None:
    found = solve_axis_turning([turned(-ANGLES_DEG)], [np.full(5, np.nan)])
    assert_allclose(found.axis.direction, UP, atol=1e-9)


def test_a_known_up_wins_over_angles() -> None:
    found = solve_axis_turning([turned(-ANGLES_DEG)], [np.radians(ANGLES_DEG)], up=np.array([0.0, -1.0, 0.0]))
    assert_allclose(found.axis.direction, UP, atol=1e-9)


def test_a_turn_beyond_half_a_circle_is_no_contradiction() -> None:
    angles = np.array([0.0, 100.0, 200.0, 300.0])
    found = solve_axis_turning([turned(angles)], [np.radians(angles)])
    assert_allclose(found.axis.direction, UP, atol=1e-9)
    assert found.warnings == ()


@pytest.mark.parametrize("angles", [[0.0], [0.0, 0.5, -0.5], []])
def test_a_board_that_does_not_turn_gives_no_axis(angles: list[float]) -> None:
    with pytest.raises(CalibrationError, match="two angles"):
        solve_axis_turning([turned(np.array(angles))], [np.radians(angles)])


def along_axis(count: int, noise_mm: float, seed: int = 0) -> Points:
    rng = np.random.default_rng(seed)
    points: Points = POINT + np.linspace(-50.0, 50.0, count)[:, None] * UP
    return points + rng.normal(size=(count, 3)) * noise_mm


def test_a_laser_line_along_the_axis_gives_the_axis() -> None:
    found = solve_axis_line(along_axis(300, 0.1))
    assert_allclose(found.axis.direction, UP, atol=2e-3)
    assert distance_to_axis(found.axis.point_mm) < 0.1
    assert found.rms_mm == pytest.approx(0.14, abs=0.04)


def test_points_beside_the_line_do_not_bend_it() -> None:
    points = along_axis(300, 0.05)
    points[::20] += np.random.default_rng(1).uniform(-30.0, 30.0, (15, 3))
    assert_allclose(solve_axis_line(points).axis.direction, UP, atol=5e-3)


def test_too_few_points_are_no_line() -> None:
    with pytest.raises(CalibrationError, match="laser line along the axis was not seen"):
        solve_axis_line(along_axis(9, 0.1))
