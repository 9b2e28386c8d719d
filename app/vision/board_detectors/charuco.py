"""Corners of a chessboard whose white squares hold markers: it may be partly hidden."""

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from app.geometry.arrays import Floats
from app.vision.board import BOARD_DETECTORS, BoardObservation, BoardSpec
from app.vision.corners import best_corners, grey_of, refine_corners, without_colour
from app.vision.markers import aruco_dictionary
from app.vision.stripe import Image

_LEAST_CORNERS = 4


@dataclass(frozen=True)
class CharucoDetector:
    """OpenCV's detector; a board may also have been printed in the pattern of before OpenCV 4.6.

    The two patterns differ only where the number of rows is even.
    """

    def detect(self, image: Image, spec: BoardSpec) -> BoardObservation:
        grey = grey_of(image)
        best = BoardObservation.empty()
        for is_legacy in (False, True) if spec.rows % 2 == 0 else (False,):
            observation = _observed(image, grey, spec, is_legacy)
            if len(observation.ids) > len(best.ids):
                best = observation
        return best


def _observed(image: Image, grey: Image, spec: BoardSpec, is_legacy: bool) -> BoardObservation:
    corners, numbers, _, _ = _detector(spec, is_legacy).detectBoard(grey)
    if numbers is None or len(numbers) < _LEAST_CORNERS:
        return BoardObservation.empty()
    ids = np.asarray(numbers, np.intp).ravel()
    points = spec.points()[ids]
    if np.linalg.matrix_rank(points[:, :2] - points[:, :2].mean(axis=0)) < 2:
        return BoardObservation.empty()
    start = np.asarray(corners, np.float64).reshape(-1, 2)
    sizes = np.full(len(ids), _square_px(start, points[:, :2], spec.spacing_mm))
    candidates = [refine_corners(grey, start, sizes), start]
    if image.ndim == 3:
        candidates.insert(1, refine_corners(without_colour(image), start, sizes))
    chosen, believed = best_corners(candidates, points[:, :2])
    return BoardObservation(ids, chosen, points).select(believed)


def _square_px(corners: Floats, board: Floats, spacing_mm: float) -> float:
    """The square's shorter extent in the picture, from an affine map: a marker's cell must not spoil it."""
    centred = board - board.mean(axis=0)
    affine = np.linalg.lstsq(centred, corners - corners.mean(axis=0), rcond=None)[0]
    return spacing_mm * float(np.linalg.svd(affine, compute_uv=False)[-1])


@cache
def _detector(spec: BoardSpec, is_legacy: bool) -> cv2.aruco.CharucoDetector:
    board = cv2.aruco.CharucoBoard(
        (spec.columns, spec.rows), spec.spacing_mm, spec.marker_mm, aruco_dictionary(spec.dictionary)
    )
    board.setLegacyPattern(is_legacy)
    detector = cv2.aruco.CharucoDetector(board)
    parameters = detector.getCharucoParameters()
    parameters.tryRefineMarkers = True
    detector.setCharucoParameters(parameters)
    return detector


BOARD_DETECTORS.register("charuco", CharucoDetector)
