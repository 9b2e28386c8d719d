"""The camera's views so far: what each shows, which of them count, and how well they fit each other."""

from collections.abc import Mapping

import numpy as np

from app.calibration.capture_goals import Goals, Stance
from app.calibration.intrinsics import solve_intrinsics
from app.calibration.struck import Struck
from app.documents import Json
from app.errors import CalibrationError
from app.geometry.arrays import Pixels
from app.vision.board import BoardObservation

# With fewer views nobody can tell which of them is wrong.
_FEWEST_RATED = 5


class CameraViews:
    """Views of a board that is held before the camera.

    Attributes:
        size: of the pictures.
        struck: which of them are left out.
    """

    def __init__(self, size: tuple[int, int], struck: Struck) -> None:
        self.size, self.struck = size, struck
        self._seen: dict[int, BoardObservation] = {}
        self._stances: dict[int, Stance] = {}

    def add(self, number: int, seen: BoardObservation) -> None:
        """A view that is on disk."""
        self._seen[number] = seen
        self._stances[number] = Stance.of(seen, self.size)

    @property
    def goals(self) -> Goals:
        """What those that count have shown."""
        out = self.struck.reasons
        goals = Goals(self.size)
        for number, stance in self._stances.items():
            if number not in out:
                goals.add(stance)
        return goals

    def rate(self) -> Mapping[int, float]:
        """How well each of those that count fits, px RMS by number; what does not fit is struck out."""
        out = self.struck.reasons
        numbers = [number for number in self._seen if number not in out]
        if len(numbers) < _FEWEST_RATED:
            return {}
        try:
            found = solve_intrinsics([self._seen[number] for number in numbers], self.size)
        except CalibrationError:
            return {}
        self.struck.strike_bad({numbers[view.index]: view.reason for view in found.dropped})
        return {numbers[view.index]: view.rms_px for view in found.views}


def seen_json(seen: BoardObservation) -> Json:
    """What a frame's entry keeps of the board in it."""
    corners = np.round(seen.corners, 1).tolist()
    return {"seen": {"corners": corners, "outline": np.round(outline(seen), 1).tolist()}}


def outline(seen: BoardObservation) -> Pixels:
    """The outermost corners that are seen, (4, 2) px, in the order of a walk around; (0, 2) for no board."""
    if not seen.is_found:
        return np.zeros((0, 2))
    x, y = seen.board_points[:, 0], seen.board_points[:, 1]
    ends = [np.argmin(x + y), np.argmax(x - y), np.argmax(x + y), np.argmin(x - y)]
    return seen.corners[ends]
