"""Which stripe points lie clear of the edges between the board's black and white."""

import numpy as np
from numpy.typing import NDArray

from app.calibration.poses import points_on_board
from app.geometry.arrays import Pixels
from app.geometry.camera import CameraIntrinsics
from app.geometry.transform import RigidTransform
from app.vision.board import BoardSpec
from app.vision.stripe import LaserStripe

# Nearer to an edge than this, in stripe sigmas, the brighter side pulls at the stripe: 0.7 px at one sigma,
# less than the noise from here on.
_FOOT_SIGMAS = 2.5
# What the lens blurs across the lines, px.
_BLUR_PX = 1.5
# Of a square's side, at most, so that a wide stripe on small squares keeps the middle of each.
_LARGEST_SHARE = 0.2
_OUTSIDE = -2.0


def clear_of_edges(
    camera: CameraIntrinsics, pose: RigidTransform, board: BoardSpec, stripe: LaserStripe, across: int
) -> NDArray[np.bool_]:
    """Mask (N,) of the stripe points whose light falls into one square of a chessboard or beside them all.

    The error of a point at an edge repeats in its neighbours, so that no average and no robust loss removes
    it; a stripe that runs along an edge is wrong as a whole. Of a ChArUco board the black squares and the
    margin are clear. Dots leave too little between their edges, and all points are taken.

    Args:
        pose: camera from board.
        across: 0 where the stripe was located along u, else 1.
    """
    if board.kind not in ("chessboard", "charuco") or not len(stripe):
        return np.ones(len(stripe), np.bool_)
    side_px = board.spacing_mm * float(camera.matrix[0, 0]) / float(np.linalg.norm(pose.translation))
    foot = min(_FOOT_SIGMAS * float(np.median(stripe.width)), _LARGEST_SHARE * side_px)
    reach = np.array([foot, _BLUR_PX] if across == 0 else [_BLUR_PX, foot])
    around = [np.array([i, j]) * reach for i in (-1.0, 1.0) for j in (-1.0, 1.0)]
    squares = [_squares(camera, pose, board, stripe.pixels + offset) for offset in around]
    clear: NDArray[np.bool_] = np.all([square == squares[0] for square in squares], axis=(0, 2))
    if board.kind == "charuco":
        # The square before the first inner corner is black, its neighbours carry the markers.
        is_black = squares[0].sum(axis=1) % 2 == 0
        clear &= is_black | (squares[0][:, 0] == _OUTSIDE)
    return clear


def _squares(
    camera: CameraIntrinsics, pose: RigidTransform, board: BoardSpec, pixels: Pixels
) -> NDArray[np.float64]:
    """Column and row (N, 2) of the square that each pixel shows; one and the same outside the pattern."""
    on_board = pose.inverse() @ points_on_board(camera, pose, pixels)
    square = np.floor(on_board[:, :2] / board.spacing_mm)
    rows, columns = board.shape
    last = np.array([columns, rows]) - 1.0
    outside = np.any((square < -1.0) | (square > last), axis=1)
    square[outside] = _OUTSIDE
    return square
