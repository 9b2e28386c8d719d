"""The calibration board: what is printed, and where its corners are seen."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Pixels, Points

BoardKind = Literal["chessboard", "charuco", "circles", "asymmetric_circles"]


@dataclass(frozen=True, slots=True)
class BoardSpec:
    """A flat calibration target.

    Attributes:
        kind: what is printed.
        columns: inner corners (chessboard), squares (charuco) or dots (circles) across.
        rows: the same, down.
        spacing_mm: side of a square, or distance of neighbouring dots as `recording-format.md` has it.
        marker_mm: side of a ChArUco marker.
        dictionary: ArUco dictionary of a ChArUco board, such as DICT_4X4_50.
    """

    kind: BoardKind
    columns: int
    rows: int
    spacing_mm: float
    marker_mm: float = 0.0
    dictionary: str = ""


@dataclass(frozen=True, eq=False, slots=True)
class BoardObservation:
    """Corners of the board in one picture.

    Attributes:
        ids: (N,) number of each corner on the board; N = 0 where the board was not found.
        corners: (N, 2) pixels.
        board_points: (N, 3) the same corners on the board, mm, z = 0.
    """

    ids: NDArray[np.intp]
    corners: Pixels
    board_points: Points

    @property
    def is_found(self) -> bool:
        return len(self.ids) > 0
