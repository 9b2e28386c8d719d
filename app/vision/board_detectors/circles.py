"""Centres of printed dots, in a square or in a staggered grid."""

from dataclasses import dataclass

import cv2
import numpy as np

from app.geometry.arrays import Floats, Pixels
from app.vision.board import BOARD_DETECTORS, BoardObservation, BoardSpec
from app.vision.corners import best_corners, grey_of, projected, without_colour
from app.vision.dot_grid import find_grid
from app.vision.dots import find_dots
from app.vision.stripe import Image


@dataclass(frozen=True)
class CirclesDetector:
    """Elliptical spots that form the printed grid, then the centre of darkness of each dot.

    A circle seen at a slant is an ellipse whose centre is not the picture of the circle's centre; that
    shift is computed from the size of the dots and taken out.
    """

    def detect(self, image: Image, spec: BoardSpec) -> BoardObservation:
        grey = without_colour(image) if image.ndim == 3 else grey_of(image)
        for dark_dots in (grey, np.asarray(255 - grey, np.uint8)):
            found = find_grid(find_dots(dark_dots), spec)
            if len(found):
                return _refined(dark_dots, found, spec)
        return BoardObservation.empty()


def _refined(grey: Image, found: Pixels, spec: BoardSpec) -> BoardObservation:
    points = spec.points()
    board = points[:, :2]
    homography = np.asarray(cv2.findHomography(board, found)[0], np.float64)
    if homography.shape != (3, 3):
        return BoardObservation.empty()
    nearest = spec.spacing_mm * (1.0 if spec.kind == "circles" else np.sqrt(2.0))
    centred, radius_mm = _centres_of_darkness(grey, found, homography, board, nearest)
    corrected = centred - _slant_shift(homography, board, radius_mm)
    corners, believed = best_corners([corrected, centred], board)
    return BoardObservation(np.arange(len(points)), corners, points).select(believed)


def _centres_of_darkness(
    grey: Image, centres: Pixels, homography: Floats, board: Floats, nearest_mm: float
) -> tuple[Pixels, float]:
    """Centroids (N, 2) of the dots, weighted by how dark each pixel is, and the dots' radius in mm.

    Each dot is weighed in the picture of the disk that reaches half way to its neighbours.
    """
    inverse = np.asarray(np.linalg.inv(homography), np.float64)
    better, areas = centres.copy(), []
    for number, centre in enumerate(centres):
        around = board[number] + 0.5 * nearest_mm * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        outline = projected(homography, around)
        low = np.maximum(np.floor(outline.min(axis=0)), 0).astype(int)
        high = np.minimum(np.ceil(outline.max(axis=0)) + 1, grey.shape[::-1]).astype(int)
        patch = grey[low[1] : high[1], low[0] : high[0]].astype(np.float64)
        if patch.size < 9:
            continue
        v, u = np.mgrid[low[1] : high[1], low[0] : high[0]]
        pixels = np.column_stack([u.ravel(), v.ravel()]).astype(np.float64)
        offset = projected(inverse, pixels) - projected(inverse, centre[None])
        inside = np.hypot(offset[:, 0], offset[:, 1]) < 0.5 * nearest_mm
        values = patch.ravel()[inside]
        if len(values) < 9:
            continue
        dark, bright = np.percentile(values, [5.0, 95.0])
        weights = np.clip((0.9 * bright + 0.1 * dark - values) / max(0.8 * (bright - dark), 1.0), 0.0, 1.0)
        if weights.sum() > 0.0:
            better[number] = weights @ pixels[inside] / weights.sum()
            per_mm2 = len(values) / (np.pi * (0.5 * nearest_mm) ** 2)
            areas.append(weights.sum() / per_mm2)
    radius_mm = float(np.sqrt(np.median(areas) / np.pi)) if areas else 0.0
    return better, radius_mm


def _slant_shift(homography: Floats, board: Floats, radius_mm: float) -> Pixels:
    """Centre of each dot's ellipse minus the picture of the dot's centre, (N, 2) px.

    The dual conic of a circle about c with radius r is c c^T - r^2 diag(1, 1, 0); it maps with the
    homography, and the centre of the ellipse is the last column of its picture.
    """
    middle = np.column_stack([board, np.ones(len(board))])
    dual = middle[:, :, None] * middle[:, None, :] - radius_mm**2 * np.diag([1.0, 1.0, 0.0])
    seen = homography @ dual @ homography.T
    shift: Pixels = seen[:, :2, 2] / seen[:, 2:, 2] - projected(homography, board)
    return shift


BOARD_DETECTORS.register("circles", CirclesDetector)
BOARD_DETECTORS.register("asymmetric_circles", CirclesDetector)
