"""Laser planes that others found in the same pictures and points."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from app.calibration.laser_plane import LaserPlaneResult, solve_laser_plane
from app.calibration.poses import board_pose, points_on_board, stripe_on_board
from app.geometry.camera import CameraIntrinsics
from app.vision.board import BoardObservation, BoardSpec, detect_board
from app.vision.stripe import STRIPE_DETECTORS, Image, LaserView

BOARD = BoardSpec("chessboard", 8, 6, 40.0)
MATRIX = np.array([[514.4, 0.0, 329.8], [0.0, 685.9, 237.7], [0.0, 0.0, 1.0]])
K1 = -0.35


def with_the_unstated_terms(boards: list[BoardObservation]) -> CameraIntrinsics:
    """The published camera; k2, p1 and p2, which are not stated, as these boards have them."""
    held = cv2.CALIB_FIX_FOCAL_LENGTH | cv2.CALIB_FIX_PRINCIPAL_POINT | cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K3
    found = cv2.calibrateCamera(
        [board.board_points.astype(np.float32) for board in boards],
        [board.corners.astype(np.float32) for board in boards],
        (640, 480),
        MATRIX.copy(),
        np.array([K1, 0.0, 0.0, 0.0, 0.0]),
        flags=cv2.CALIB_USE_INTRINSIC_GUESS | held,
    )
    return CameraIntrinsics(MATRIX, np.asarray(found[2], np.float64).ravel()[:5], (640, 480))


def plane_of(
    images: list[Image], boards: list[BoardObservation], camera: CameraIntrinsics
) -> LaserPlaneResult:
    detector = STRIPE_DETECTORS.make("zero-crossing")
    poses = []
    for image, board in zip(images, boards, strict=True):
        pose = board_pose(camera, board.corners, board.board_points).camera_from_board
        pixels = detector.detect(LaserView(image, None, "green")).pixels
        poses.append(points_on_board(camera, pose, pixels[stripe_on_board(camera, pose, BOARD, pixels)]))
    return solve_laser_plane("green", poses)


def test_the_stripe_on_six_boards_lies_on_the_published_plane(shared_data: Path) -> None:
    """n = (-0.99989, -0.01409, -0.00503), d = 39.52 mm, 0.30 mm RMS; our normals look the other way.

    The distortion beyond k1 is not stated. With it fitted to these six boards the normal agrees to the
    last stated digit or two, the distance to 0.2 mm, less than the points scatter; with k1 alone to 0.3 mm.
    """
    paths = sorted((shared_data / "stripe-on-board").glob("*.jpg"))
    images = [np.asarray(cv2.imread(str(path)), np.uint8) for path in paths]
    boards = [detect_board(image, BOARD) for image in images]
    assert [board.is_found for board in boards] == [True] * 6
    fitted = plane_of(images, boards, with_the_unstated_terms(boards))
    plain = plane_of(images, boards, CameraIntrinsics(MATRIX, np.array([K1, 0, 0, 0, 0.0]), (640, 480)))
    assert_allclose(-fitted.plane.normal, (-0.99989, -0.01409, -0.00503), atol=2e-4)
    assert_allclose(-plain.plane.normal, (-0.99989, -0.01409, -0.00503), atol=5e-4)
    for found in (fitted, plain):
        assert -found.plane.distance_mm == pytest.approx(39.52, abs=0.31)
        assert found.rms_mm == pytest.approx(0.30, abs=0.04)
        assert found.share_used > 0.8
