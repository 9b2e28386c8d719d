"""Laser planes from stripes on boards."""

import numpy as np
import pytest

from app.calibration.laser_plane import solve_laser_plane
from app.errors import CalibrationError
from app.geometry.arrays import Points
from app.geometry.plane import LaserPlane

TRUTH = LaserPlane.through(np.array([0.0, 0.0, 300.0]), np.array([0.85, -0.05, 0.52]))
DEPTHS_MM = (-60.0, -30.0, 0.0, 30.0, 60.0)


def stripe(depth_mm: float, count: int, rng: np.random.Generator, noise_mm: float = 0.05) -> Points:
    """Points of the laser's plane on one straight line, moved across it by noise."""
    up = np.cross(TRUTH.normal, [0.3, 0.0, 1.0])
    up /= np.linalg.norm(up)
    deep = np.cross(up, TRUTH.normal)
    along = np.linspace(-50.0, 50.0, count)[:, None]
    foot = TRUTH.normal * TRUTH.distance_mm + depth_mm * deep
    across: Points = foot + along * up + rng.normal(size=(count, 1)) * noise_mm * TRUTH.normal
    return across


def off_mm(plane: LaserPlane) -> float:
    """Largest distance from the true plane within 60 mm about the middle of the stripes."""
    places = np.concatenate([stripe(depth, 3, np.random.default_rng(0), 0.0) for depth in (-60.0, 60.0)])
    return float(np.abs(plane.signed_distance(places)).max())


def test_a_plane_is_found_through_the_stripes_of_all_poses() -> None:
    rng = np.random.default_rng(0)
    found = solve_laser_plane("left", [stripe(depth, 200, rng) for depth in DEPTHS_MM])
    assert off_mm(found.plane) < 0.02
    assert found.rms_mm == pytest.approx(0.05, rel=0.2)
    assert len(found.pose_rms_mm) == 5
    assert found.warnings == ()


@pytest.mark.parametrize("seed", range(3))
def test_three_of_ten_points_may_be_anywhere(seed: int) -> None:
    rng = np.random.default_rng(seed)
    poses = [stripe(depth, 200, rng) for depth in DEPTHS_MM]
    for points in poses:
        stray = rng.choice(200, 60, replace=False)
        points[stray] += rng.uniform(-40.0, 40.0, (60, 3))
    robust = solve_laser_plane("left", poses)
    assert off_mm(robust.plane) < 0.05
    assert robust.share_used == pytest.approx(0.7, abs=0.05)
    assert off_mm(solve_laser_plane("left", poses, robust=False).plane) > 10.0 * off_mm(robust.plane)


def test_the_papers_plain_fit_is_there_too() -> None:
    rng = np.random.default_rng(1)
    found = solve_laser_plane("left", [stripe(depth, 200, rng) for depth in DEPTHS_MM], robust=False)
    assert found.share_used == 1.0
    assert off_mm(found.plane) < 0.02


def test_a_pose_with_most_of_the_points_does_not_rule_alone() -> None:
    rng = np.random.default_rng(2)
    poses = [stripe(-60.0, 900, rng), stripe(0.0, 60, rng), stripe(60.0, 60, rng)]
    assert off_mm(solve_laser_plane("left", poses).plane) < 0.05


def test_two_poses_give_a_plane_that_nothing_checks() -> None:
    rng = np.random.default_rng(3)
    found = solve_laser_plane("left", [stripe(-40.0, 200, rng), stripe(40.0, 200, rng)])
    assert off_mm(found.plane) < 0.05
    assert "nothing checks" in found.warnings[0]


def test_poses_at_nearly_one_depth_leave_the_plane_ill_conditioned() -> None:
    rng = np.random.default_rng(4)
    found = solve_laser_plane("left", [stripe(depth, 200, rng) for depth in (-1.0, 0.0, 1.0, 2.0)])
    assert any("ill-conditioned" in text and "'left'" in text for text in found.warnings)


def test_noisy_stripes_leave_the_plane_in_doubt() -> None:
    rng = np.random.default_rng(5)
    found = solve_laser_plane("left", [stripe(depth, 200, rng, 2.0) for depth in (-20.0, 0.0, 20.0)])
    assert found.predicted_mm > 0.2
    assert any("ill-conditioned" in text for text in found.warnings)


@pytest.mark.parametrize(("count", "seen"), [(0, "no pose"), (1, "one pose")])
def test_fewer_than_two_poses_are_no_plane(count: int, seen: str) -> None:
    rng = np.random.default_rng(6)
    poses = [stripe(0.0, 100, rng) for _ in range(count)]
    with pytest.raises(CalibrationError, match=f"'left' was seen on the board in {seen}"):
        solve_laser_plane("left", poses)


def test_stripes_on_one_line_are_no_plane() -> None:
    line = np.linspace(0.0, 1.0, 50)[:, None] * np.array([[10.0, 20.0, 30.0]]) + [0.0, 0.0, 300.0]
    with pytest.raises(CalibrationError, match="cannot be fitted"):
        solve_laser_plane("left", [line, line, line])
