"""Square ArUco markers that are fixed on the table."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats


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
