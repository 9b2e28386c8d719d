"""The part of the cloud that is shown, and the box around it."""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from viser import LineSegmentsHandle, ViserServer

from app.errors import OptionError
from app.viewer.display import DisplayPoints
from app.viewer.stage import TABLE

Corner = tuple[float, float, float]
_BOX = f"{TABLE}/crop"
_COLOUR = (242, 170, 60)


@dataclass(frozen=True, slots=True)
class CropBox:
    """A box in the table frame, along its axes.

    Attributes:
        low, high: its corners, mm.

    Raises:
        OptionError: `low` is not below `high`.
    """

    low: Corner
    high: Corner

    def __post_init__(self) -> None:
        if not all(low < high for low, high in zip(self.low, self.high, strict=True)):
            raise OptionError(
                "The box that is to be shown has no inside.", "Make each lower end less than its upper end."
            )

    def holds(self, points: NDArray[np.float32]) -> NDArray[np.bool_]:
        """(N,) which of (N, 3) points lie inside or on its border."""
        inside = (points >= self.low) & (points <= self.high)
        return np.asarray(inside.all(axis=1), np.bool_)

    def of(self, shown: DisplayPoints) -> DisplayPoints:
        """The points inside it."""
        inside = self.holds(shown.points)
        return shown if inside.all() else shown.select(np.flatnonzero(inside))

    @property
    def edges(self) -> NDArray[np.float64]:
        """(12, 2, 3) from corner to corner."""
        corners = np.array(list(product(*zip(self.low, self.high, strict=True))))
        return np.array(
            [
                (a, b)
                for number, a in enumerate(corners)
                for b in corners[number + 1 :]
                if np.count_nonzero(a != b) == 1
            ]
        )


class CropLines:
    """Draws the box; used by one thread."""

    def __init__(self, server: ViserServer) -> None:
        self._server = server
        self._lines: LineSegmentsHandle | None = None

    def draw(self, box: CropBox | None) -> None:
        """Instead of the one there was; none takes it away."""
        if box is not None:
            self._lines = self._server.scene.add_line_segments(
                _BOX, box.edges, _COLOUR, thickness=1.5, thickness_units="screen"
            )
        elif self._lines is not None:
            self._lines.remove()
            self._lines = None
