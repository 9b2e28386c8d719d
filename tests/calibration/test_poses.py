"""Where a board stands, and which part of a stripe lies on it."""

import numpy as np
from numpy.testing import assert_allclose

from app.calibration.poses import board_pose, points_on_board, stripe_on_board
from app.geometry.arrays import Points
from app.geometry.transform import RigidTransform, rotation_from_rvec
from app.vision.board import BoardSpec
from benchmarks.synthetic_views import typical_rig

BOARD = BoardSpec("chessboard", 9, 6, 10.0)
CAMERA = typical_rig().camera
POSE = RigidTransform(
    rotation_from_rvec(np.array([0.3, -0.4, 0.1])) @ np.diag([1.0, -1.0, -1.0]),
    np.array([-35.0, 30.0, 310.0]),
)


def test_the_pose_of_a_board_is_found_from_its_corners() -> None:
    corners = CAMERA.project(POSE @ BOARD.points())
    found = board_pose(CAMERA, corners, BOARD.points())
    assert_allclose(found.camera_from_board.rotation, POSE.rotation, atol=1e-5)
    assert_allclose(found.camera_from_board.translation, POSE.translation, atol=1e-3)
    assert found.rms_px < 1e-3


def test_the_flipped_twin_of_a_pose_is_not_taken() -> None:
    for seed in range(20):
        rng = np.random.default_rng(seed)
        rotation = rotation_from_rvec(rng.normal(size=3) * 0.25) @ np.diag([1.0, -1.0, -1.0])
        pose = RigidTransform(rotation, np.array([-30.0, 25.0, 400.0]))
        corners = CAMERA.project(pose @ BOARD.points()) + rng.normal(size=(54, 2)) * 0.1
        found = board_pose(CAMERA, corners, BOARD.points())
        cosine = float(found.camera_from_board.rotation[:, 2] @ rotation[:, 2])
        assert cosine > np.cos(np.radians(3.0))


def stripe(y_mm: np.ndarray, x_mm: float = 33.0) -> Points:
    return np.column_stack([np.full(len(y_mm), x_mm), y_mm, np.zeros(len(y_mm))])


def test_rays_meet_the_board_where_they_came_from() -> None:
    points = POSE @ stripe(np.linspace(0.0, 50.0, 30))
    assert_allclose(points_on_board(CAMERA, POSE, CAMERA.project(points)), points, atol=1e-6)


def test_only_the_part_of_a_stripe_on_the_board_is_kept() -> None:
    on_board = POSE @ stripe(np.linspace(-8.0, 58.0, 120))
    behind = on_board[:40] + POSE.rotation[:, 2] * 90.0 + np.array([20.0, 0.0, 0.0])
    pixels = CAMERA.project(np.concatenate([on_board, behind]))
    kept = stripe_on_board(CAMERA, POSE, BOARD, pixels)
    assert kept[:120].mean() > 0.95
    assert not kept[120:].any()


def test_a_stripe_far_beside_the_board_is_not_on_it() -> None:
    pixels = CAMERA.project(POSE @ stripe(np.linspace(-8.0, 58.0, 120), x_mm=170.0))
    assert not stripe_on_board(CAMERA, POSE, BOARD, pixels).any()


def test_a_scatter_of_points_is_no_stripe() -> None:
    rng = np.random.default_rng(0)
    places = np.column_stack([rng.uniform(0.0, 80.0, 200), rng.uniform(0.0, 50.0, 200), np.zeros(200)])
    assert not stripe_on_board(CAMERA, POSE, BOARD, CAMERA.project(POSE @ places)).any()


def test_a_few_points_are_not_trusted() -> None:
    pixels = CAMERA.project(POSE @ stripe(np.linspace(0.0, 50.0, 11)))
    assert not stripe_on_board(CAMERA, POSE, BOARD, pixels).any()
    assert len(stripe_on_board(CAMERA, POSE, BOARD, np.zeros((0, 2)))) == 0
