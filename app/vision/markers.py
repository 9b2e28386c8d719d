"""Square ArUco markers that are fixed on the table."""

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from app.errors import OptionError
from app.geometry.arrays import Floats
from app.vision.stripe import Image

_REFINEMENT_SHARE = 0.09
"""Half the refinement window as a share of the marker's side.

A cell of a 4 x 4 marker is a sixth of the side, and so may be the white border: a window that reaches its
outer edge pulls the corners off by pixels.
"""
_SMALLEST_HALF, _LARGEST_HALF = 2, 7


@dataclass(frozen=True, slots=True)
class PlatterSpec:
    """Markers on the table; where they lie is unknown.

    Attributes:
        dictionary: ArUco dictionary, such as DICT_4X4_50.
        marker_mm: side of a marker.
        ids: numbers of the markers that are there.
    """

    dictionary: str
    marker_mm: float
    ids: tuple[int, ...]


@dataclass(frozen=True, eq=False, slots=True)
class MarkerObservation:
    """Markers seen in one picture.

    Attributes:
        ids: (M,) numbers.
        corners: (M, 4, 2) pixels, clockwise in the picture from the marker's own top left.
    """

    ids: NDArray[np.intp]
    corners: Floats

    @property
    def is_found(self) -> bool:
        return len(self.ids) > 0


def aruco_dictionary(name: str) -> cv2.aruco.Dictionary:
    """OpenCV's dictionary of that name.

    Raises:
        OptionError: there is none.
    """
    number = getattr(cv2.aruco, name, None) if name.startswith("DICT_") else None
    if not isinstance(number, int):
        raise OptionError(
            f"There is no ArUco dictionary called {name!r}.",
            "Name one as OpenCV does, such as DICT_4X4_50 or DICT_6X6_250.",
        )
    return cv2.aruco.getPredefinedDictionary(number)


def detect_markers(image: Image, platter: PlatterSpec) -> MarkerObservation:
    """The platter's markers in a grey or BGR picture, lowest number first; other markers are left out.

    A marker that seems to be seen twice is left out too: one of the two is false.
    """
    grey: Image = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image, np.uint8)
    quads, found, _ = _detector(platter.dictionary).detectMarkers(grey)
    numbers = np.zeros(0, np.intp) if found is None else np.asarray(found, np.intp).ravel()
    ids, first, times = np.unique(numbers, return_index=True, return_counts=True)
    keep = np.isin(ids, platter.ids) & (times == 1)
    corners = [_refined(grey, np.asarray(quads[i], np.float32).reshape(4, 2)) for i in first[keep]]
    return MarkerObservation(ids[keep], np.array(corners, np.float64).reshape(-1, 4, 2))


@cache
def _detector(dictionary: str) -> cv2.aruco.ArucoDetector:
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_NONE
    return cv2.aruco.ArucoDetector(aruco_dictionary(dictionary), parameters)


def _refined(grey: Image, quad: NDArray[np.float32]) -> NDArray[np.float32]:
    """Sub-pixel corners; where the refinement runs away from the outline, the outline's own corner stays."""
    side = float(np.linalg.norm(quad - np.roll(quad, 1, axis=0), axis=1).min())
    half = int(np.clip(round(_REFINEMENT_SHARE * side), _SMALLEST_HALF, _LARGEST_HALF))
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-3)
    start = quad.reshape(-1, 1, 2).copy()
    refined = np.asarray(cv2.cornerSubPix(grey, start, (half, half), (-1, -1), criteria)).reshape(4, 2)
    ran_away = np.linalg.norm(refined - quad, axis=1) > half
    return np.where(ran_away[:, None], quad, refined).astype(np.float32)
