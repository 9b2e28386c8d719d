"""The calibration board: what is printed, and where its corners are seen."""

import math
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from app.errors import OptionError
from app.geometry.arrays import Pixels, Points
from app.registry import Registry
from app.vision.markers import aruco_dictionary
from app.vision.stripe import Image

BoardKind = Literal["chessboard", "charuco", "circles", "asymmetric_circles"]


@dataclass(frozen=True, slots=True)
class BoardSpec:
    """A flat calibration target.

    Its frame: x along a row, y from row to row, z into the board; the first corner is the origin. Corners are
    numbered row by row.

    Attributes:
        kind: what is printed.
        columns: inner corners (chessboard), squares (charuco) or dots (circles) across. A row of an
            asymmetric grid has `columns` dots and every second row is shifted.
        rows: the same, down.
        spacing_mm: side of a square, distance of neighbouring dots (circles), or distance of
            neighbouring rows (asymmetric_circles, whose dots are twice that apart within a row).
        marker_mm: side of a ChArUco marker.
        dictionary: ArUco dictionary of a ChArUco board, such as DICT_4X4_50.
    """

    kind: BoardKind
    columns: int
    rows: int
    spacing_mm: float
    marker_mm: float = 0.0
    dictionary: str = ""

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the corners that are looked for."""
        if self.kind == "charuco":
            return self.rows - 1, self.columns - 1
        return self.rows, self.columns

    @property
    def description(self) -> str:
        """The board as a person would order it."""
        name = self.kind.replace("_", " ")
        text = f"{name} {self.columns} x {self.rows}, {self.spacing_mm:g} mm"
        return f"{text}, markers {self.marker_mm:g} mm {self.dictionary}" if self.kind == "charuco" else text

    def points(self) -> Points:
        """Every corner on the board, (N, 3) mm, z = 0, in the order of their numbers."""
        rows, columns = self.shape
        row, column = np.divmod(np.arange(rows * columns), columns)
        x = 2 * column + row % 2 if self.kind == "asymmetric_circles" else column
        return np.column_stack([x, row, np.zeros_like(row)]) * self.spacing_mm

    def outline(self, margin_mm: float = 0.0) -> Points:
        """The corners (4, 3) of the printed pattern on the board, mm, in the order of a walk around it.

        Args:
            margin_mm: how much further out than the pattern itself.
        """
        points = self.points()
        squares = self.kind in ("chessboard", "charuco")
        border = margin_mm + self.spacing_mm * (1.0 if squares else 0.5)
        left, top = points[:, :2].min(axis=0) - border
        right, bottom = points[:, :2].max(axis=0) + border
        return np.array([[left, top, 0.0], [right, top, 0.0], [right, bottom, 0.0], [left, bottom, 0.0]])

    @property
    def is_ambiguous(self) -> bool:
        """Whether the board looks the same after half a turn, so that two numberings fit every picture.

        A chessboard keeps its colours under half a turn when columns + rows is even: 8 x 6 and 7 x 5 are
        ambiguous, 9 x 6 is not. A symmetric circle grid always is; an asymmetric one when its rows are even
        in number. ChArUco never is. Boards of as many columns as rows may even repeat every quarter turn:
        print unequal numbers. The detector then numbers the corners so that rows run to the right or down in
        the picture; follow a turning board with `flipped`.
        """
        if self.kind == "chessboard":
            return (self.columns + self.rows) % 2 == 0
        if self.kind == "asymmetric_circles":
            return self.rows % 2 == 0
        return self.kind == "circles"

    def flipped(self, observation: "BoardObservation") -> "BoardObservation":
        """The same corners with the other numbering of an ambiguous board: half a turn about its middle."""
        points = self.points()
        ids = len(points) - 1 - observation.ids[::-1]
        return BoardObservation(ids, observation.corners[::-1], points[ids])

    def check(self) -> None:
        """Raise OptionError where no such board can exist or be found."""
        numbers = (self.spacing_mm, self.marker_mm)
        if not all(math.isfinite(number) for number in numbers) or self.spacing_mm <= 0.0:
            raise OptionError("The spacing of the board must be a length above zero.")
        least = 3 if self.kind == "chessboard" else 2
        if min(self.columns, self.rows) < least or max(self.columns, self.rows) > 200:
            raise OptionError(
                f"A {self.kind} board cannot have {self.columns} x {self.rows}.",
                f"Give each count between {least} and 200.",
            )
        if self.kind == "charuco":
            self._check_charuco()

    def _check_charuco(self) -> None:
        if not 0.0 < self.marker_mm < self.spacing_mm:
            raise OptionError(
                f"Markers of {self.marker_mm:g} mm do not fit into squares of {self.spacing_mm:g} mm.",
                "Make the marker smaller than the square, half to three quarters of it.",
            )
        if min(self.shape) < 1 or self.columns * self.rows < 6:
            raise OptionError("A ChArUco board needs at least 2 x 3 squares.")
        needed = self.columns * self.rows // 2
        held = len(aruco_dictionary(self.dictionary).bytesList)
        if needed > held:
            raise OptionError(
                f"{self.dictionary} has {held} markers, the board needs {needed}.",
                "Use a larger dictionary, such as DICT_5X5_250, or fewer squares.",
            )


@dataclass(frozen=True, eq=False, slots=True)
class BoardObservation:
    """Corners of the board in one picture.

    Attributes:
        ids: (N,) number of each corner on the board; N = 0 where the board was not found. Corners that are
            hidden, or spoilt by a stripe or a reflection, are left out.
        corners: (N, 2) pixels.
        board_points: (N, 3) the same corners on the board, mm, z = 0.
    """

    ids: NDArray[np.intp]
    corners: Pixels
    board_points: Points

    @property
    def is_found(self) -> bool:
        return len(self.ids) > 0

    @classmethod
    def empty(cls) -> "BoardObservation":
        return cls(np.zeros(0, np.intp), np.zeros((0, 2)), np.zeros((0, 3)))

    def select(self, which: NDArray[np.bool_] | NDArray[np.intp]) -> "BoardObservation":
        """The corners of a mask or index array."""
        return BoardObservation(self.ids[which], self.corners[which], self.board_points[which])


class BoardDetector(Protocol):
    """A way of finding one kind of board."""

    def detect(self, image: Image, spec: BoardSpec) -> BoardObservation:
        """The corners in one picture; empty where the board is not in it."""
        ...


BOARD_DETECTORS: Registry[BoardDetector] = Registry("kind of board", "app.vision.board_detectors")


def detect_board(image: Image, spec: BoardSpec) -> BoardObservation:
    """The board's corners in a grey or BGR picture, to a fraction of a pixel; empty where it is not found."""
    return BOARD_DETECTORS.make(spec.kind).detect(image, spec)
