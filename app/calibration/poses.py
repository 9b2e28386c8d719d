"""Where a flat board stands, and which stripe points fall on it."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats, Pixels, Points
from app.geometry.camera import CameraIntrinsics
from app.geometry.transform import RigidTransform
from app.vision.board import BoardSpec

# How far beyond the printed pattern the board's margin may carry the stripe, in squares.
_MARGIN_SQUARES = 3.0
_LINE_TRIALS = 200
_FEWEST_STRIPE_POINTS = 12


@dataclass(frozen=True, eq=False, slots=True)
class BoardPose:
    """A board in the camera frame.

    Attributes:
        camera_from_board: the pose.
        rms_px: of the reprojected corners.
    """

    camera_from_board: RigidTransform
    rms_px: float


def board_pose(camera: CameraIntrinsics, corners: Pixels, board_points: Points) -> BoardPose:
    """Pose of a flat board from four or more corners.

    A flat board has two poses that look nearly alike (Schweighofer and Pinz 2006; IPPE, Collins and
    Bartoli 2014); both are refined and the one that fits better is taken.

    Args:
        corners: (N, 2) px.
        board_points: (N, 3) mm, z = 0.
    """
    rays = np.ascontiguousarray(camera.rays(corners)[:, :2])
    _, rvecs, tvecs, _ = cv2.solvePnPGeneric(
        board_points, rays, np.eye(3), np.zeros(5), flags=cv2.SOLVEPNP_IPPE
    )
    best: BoardPose | None = None
    for rvec, tvec in zip(rvecs, tvecs, strict=True):
        rvec, tvec = cv2.solvePnPRefineLM(board_points, rays, np.eye(3), np.zeros(5), rvec, tvec)
        pose = RigidTransform.from_rvec(np.asarray(rvec, np.float64), np.asarray(tvec, np.float64))
        error = camera.project(pose @ board_points) - corners
        rms = float(np.sqrt(np.mean(np.sum(error**2, axis=1))))
        if best is None or rms < best.rms_px:
            best = BoardPose(pose, rms)
    assert best is not None
    return best


def points_on_board(camera: CameraIntrinsics, pose: RigidTransform, pixels: Pixels) -> Points:
    """Where rays through (N, 2) pixels meet the board's plane: (N, 3) mm, camera frame."""
    rays = camera.rays(pixels)
    normal = pose.rotation[:, 2]
    return rays * (float(normal @ pose.translation) / (rays @ normal))[:, None]


def stripe_on_board(
    camera: CameraIntrinsics,
    pose: RigidTransform,
    board: BoardSpec,
    pixels: Pixels,
) -> NDArray[np.bool_]:
    """Which stripe pixels fall on the board: near its pattern, and on one straight line there.

    Light that leaves the board falls on things behind it, where the line breaks.

    Returns:
        (N,) mask; all false where no line is long enough to be trusted.
    """
    nothing = np.zeros(len(pixels), np.bool_)
    if len(pixels) < _FEWEST_STRIPE_POINTS:
        return nothing
    on_board = pose.inverse() @ points_on_board(camera, pose, pixels)
    corners = board.points()[:, :2]
    margin = _MARGIN_SQUARES * board.spacing_mm
    near = np.all(
        (on_board[:, :2] > corners.min(axis=0) - margin) & (on_board[:, :2] < corners.max(axis=0) + margin),
        axis=1,
    )
    if np.count_nonzero(near) < _FEWEST_STRIPE_POINTS:
        return nothing
    px_mm = float(np.linalg.norm(pose.translation)) / float(camera.matrix[0, 0])
    is_on_line = np.zeros(len(pixels), np.bool_)
    is_on_line[near] = _on_common_line(on_board[near, :2], 1.5 * px_mm)
    enough = max(_FEWEST_STRIPE_POINTS, int(near.sum()) // 4)
    return is_on_line if int(is_on_line.sum()) >= enough else nothing


def _on_common_line(points: Floats, gate_mm: float) -> NDArray[np.bool_]:
    """Mask of the (N, 2) points on the line that most of them share."""
    rng = np.random.default_rng(0)
    best = np.zeros(len(points), np.bool_)
    for _ in range(_LINE_TRIALS):
        a, b = points[rng.choice(len(points), 2, replace=False)]
        along = b - a
        length = float(np.hypot(*along))
        if length < 4.0 * gate_mm:
            continue
        normal = np.array([-along[1], along[0]]) / length
        inlier = np.abs((points - a) @ normal) < gate_mm
        if np.count_nonzero(inlier) > np.count_nonzero(best):
            best = inlier
    for _ in range(3):
        if np.count_nonzero(best) < 3:
            break
        centre = points[best].mean(axis=0)
        _, _, directions = np.linalg.svd(points[best] - centre, full_matrices=False)
        best = np.abs((points - centre) @ directions[1]) < gate_mm
    return best
