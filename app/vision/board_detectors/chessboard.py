"""Inner corners of a black and white chessboard, also where a laser line crosses it or the light is poor."""

from dataclasses import dataclass

import cv2
import numpy as np

from app.geometry.arrays import Floats, Pixels
from app.vision.board import BOARD_DETECTORS, BoardObservation, BoardSpec
from app.vision.board_order import chessboard_order
from app.vision.corners import best_corners, grey_of, refine_corners, square_sizes, without_colour
from app.vision.stripe import Image

_CLASSIC = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
_CONTRAST_LIMIT, _CONTRAST_TILES = 4.0, (6, 6)


@dataclass(frozen=True)
class ChessboardDetector:
    """The classic detector where it succeeds (it is quick), the sector based one where not.

    A coloured laser line is taken out by looking at the smallest of the three channels as well. Of the
    refinements on both pictures, the one that forms the smoother pattern is kept.

    Attributes:
        longest_px: larger pictures are searched at this size and refined at their own.
    """

    longest_px: int = 1400

    def detect(self, image: Image, spec: BoardSpec) -> BoardObservation:
        grey = grey_of(image)
        colourless = without_colour(image) if image.ndim == 3 else grey
        found = self._find(grey, colourless, spec)
        if len(found) == 0:
            return BoardObservation.empty()
        grid = chessboard_order(colourless, found.reshape(*spec.shape, 2))
        start = grid.reshape(-1, 2)
        sizes = square_sizes(start, spec.shape)
        candidates = [refine_corners(grey, start, sizes), start]
        if image.ndim == 3:
            candidates.insert(1, refine_corners(colourless, start, sizes))
        points = spec.points()
        corners, believed = best_corners(candidates, points[:, :2])
        return BoardObservation(np.arange(len(points)), corners, points).select(believed)

    def _find(self, grey: Image, colourless: Image, spec: BoardSpec) -> Pixels:
        scale = min(1.0, self.longest_px / max(grey.shape))
        small, small_colourless = _shrunk(grey, scale), _shrunk(colourless, scale)
        pattern = (spec.columns, spec.rows)
        pictures = [small] if colourless is grey else [small, small_colourless]
        for picture in pictures:
            is_found, corners = cv2.findChessboardCorners(picture, pattern, flags=_CLASSIC)
            if is_found:
                return _full_size(np.asarray(corners), scale)
        # Contrast evened out tile by tile finds what CALIB_CB_EXHAUSTIVE finds, at a third of its time.
        even = cv2.createCLAHE(_CONTRAST_LIMIT, _CONTRAST_TILES).apply(pictures[-1])
        is_found, corners = cv2.findChessboardCornersSB(even, pattern, flags=0)
        if is_found:
            return _full_size(np.asarray(corners), scale)
        return np.zeros((0, 2))


def _shrunk(picture: Image, scale: float) -> Image:
    if scale == 1.0:
        return picture
    return np.asarray(cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)


def _full_size(corners: Floats, scale: float) -> Pixels:
    """Corners (N, 2) in the whole picture; the centre of the first pixel is (0, 0) at either size."""
    at_scale = corners.reshape(-1, 2).astype(np.float64)
    return (at_scale + 0.5) / scale - 0.5


BOARD_DETECTORS.register("chessboard", ChessboardDetector)
