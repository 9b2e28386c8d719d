"""Corners of a printed board to a fraction of a pixel, and which of them to believe."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats, Pixels
from app.vision.stripe import Image

_WINDOW_SHARE = 0.3
"""Half the refinement window as a share of the square: wider ones reach the next corner's edges."""
_SMALLEST_HALF, _LARGEST_HALF = 2, 10
_CRITERIA = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-3)
_SPOILT_SIGMAS, _SPOILT_PX = 6.0, 0.5
"""A corner is spoilt when it lies this many sigmas AND this many pixels off the smooth pattern."""
_LEAST_SHARE = 0.6
_BEND_ERROR = 0.15
"""Share of the pattern's bend that a cubic may miss: at the rim of a wide lens's picture it misses some."""


def grey_of(image: Image) -> Image:
    """(H, W) grey of a grey or BGR picture."""
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image, np.uint8)


def without_colour(image: Image) -> Image:
    """(H, W) smallest of blue, green and red: a coloured laser line on a black and white board vanishes."""
    if image.ndim == 2:
        return image
    blue, green, red = cv2.split(image)
    return np.asarray(cv2.min(cv2.min(blue, green), red), np.uint8)


def square_sizes(corners: Pixels, shape: tuple[int, int]) -> Floats:
    """Room around every corner of a full grid: (N,) px, the least height of the squares that meet there."""
    grid = corners.reshape(*shape, 2)
    along, down = np.diff(grid, axis=1), np.diff(grid, axis=0)
    one, other = along[:-1], down[:, :-1]
    area = np.abs(one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0])
    longest = np.maximum(np.linalg.norm(one, axis=2), np.linalg.norm(other, axis=2))
    heights = np.pad(area / np.maximum(longest, 1e-9), 1, mode="edge")
    nearby = [heights[:-1, :-1], heights[:-1, 1:], heights[1:, :-1], heights[1:, 1:]]
    sizes: Floats = np.min(nearby, axis=0).ravel()
    return sizes


def refine_corners(grey: Image, corners: Pixels, sizes: Floats) -> Pixels:
    """Saddle points nearest to (N, 2) approximate corners, each searched in a window that suits its square.

    Args:
        grey: (H, W).
        corners: within a few pixels.
        sizes: (N,) room around each corner, px.
    """
    halves = np.clip(np.rint(_WINDOW_SHARE * sizes), _SMALLEST_HALF, _LARGEST_HALF).astype(int)
    refined = np.array(corners, np.float64)
    for half in np.unique(halves):
        which = halves == half
        start = refined[which].astype(np.float32).reshape(-1, 1, 2)
        window = (int(half), int(half))
        refined[which] = np.asarray(cv2.cornerSubPix(grey, start, window, (-1, -1), _CRITERIA)).reshape(-1, 2)
    ran_away = np.linalg.norm(refined - corners, axis=1) > np.maximum(halves, 3)
    refined[ran_away] = corners[ran_away]
    return refined


def misfit(corners: Pixels, board: Floats) -> Floats:
    """How far (N, 2) corners lie off the smooth pattern they should form: (N,) px.

    The pattern is a homography of the board points (N, 2) plus, where there are corners enough, a cubic
    displacement that stands for lens distortion and a bent board; both fitted robustly.
    """
    if len(corners) < 5:
        return np.zeros(len(corners))
    homography = np.asarray(cv2.findHomography(board, corners, cv2.LMEDS)[0], np.float64)
    if homography.shape != (3, 3):
        return np.full(len(corners), np.inf)
    off = corners - projected(homography, board)
    if len(corners) >= 30:
        x, y = ((board - board.mean(axis=0)) / board.std(axis=0)).T
        terms = np.column_stack(
            [np.ones_like(x), x, y, x * x, x * y, y * y, x**3, y**3, x * x * y, x * y * y]
        )
        bend = terms @ _robust_solution(terms, off)
        unexplained = np.linalg.norm(off - bend, axis=1) - _BEND_ERROR * np.linalg.norm(bend, axis=1)
        return np.asarray(np.maximum(unexplained, 0.0), np.float64)
    return np.asarray(np.linalg.norm(off, axis=1), np.float64)


def projected(homography: Floats, board: Floats) -> Pixels:
    """Pixels (N, 2) of board points (N, 2)."""
    seen = np.column_stack([board, np.ones(len(board))]) @ homography.T
    pixels: Pixels = seen[:, :2] / seen[:, 2:]
    return pixels


def best_corners(candidates: Sequence[Pixels], board: Floats) -> tuple[Pixels, NDArray[np.bool_]]:
    """The candidate that forms the smoothest pattern, and which (N,) of its corners to believe.

    The first candidate wins unless another one is clearly better.
    """
    misfits = [misfit(candidate, board) for candidate in candidates]
    scores = [float(np.sqrt(np.mean(off**2))) for off in misfits]
    best = int(np.argmin(scores))
    if scores[0] <= 1.25 * scores[best]:
        best = 0
    return candidates[best], _is_believed(misfits[best])


def _is_believed(off: Floats) -> NDArray[np.bool_]:
    # The median length of a two-dimensional error is 1.18 of its sigma.
    sigma = float(np.median(off)) / 1.18
    limit = max(_SPOILT_SIGMAS * sigma, _SPOILT_PX)
    believed = off <= limit
    if believed.mean() < _LEAST_SHARE:
        return np.ones(len(off), np.bool_)
    return believed


def _robust_solution(terms: Floats, values: Floats) -> Floats:
    """Least squares (K, 2) in which far-off rows have less say (Huber's weights)."""
    weights = np.ones(len(values))
    solution: Floats = np.zeros((terms.shape[1], values.shape[1]))
    for _ in range(6):
        root = np.sqrt(weights)[:, None]
        solution = np.asarray(np.linalg.lstsq(root * terms, root * values, rcond=None)[0], np.float64)
        off = np.linalg.norm(values - terms @ solution, axis=1)
        scale = max(2.0 * float(np.median(off)), 1e-6)
        weights = scale / np.maximum(off, scale)
    return solution
