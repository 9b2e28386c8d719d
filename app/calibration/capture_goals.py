"""What views of a board that is held by hand have shown of the camera, and what they should show next."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.calibration.coverage import Coverage
from app.calibration.poses import board_pose
from app.geometry.arrays import Floats, Pixels, unit
from app.geometry.camera import CameraIntrinsics
from app.vision.board import BoardObservation

ENOUGH_VIEWS = 12
_ENOUGH_COVERAGE = 0.75
_ENOUGH_TILT_DEG = 18.0
_ENOUGH_DISTANCES = 1.35
# How the normal of a board must lie for a tilt to count as one to that side; both at a diagonal.
_SIDEWAYS = 0.45
# What makes a pose another one: shift in widths of the picture, change of distance, turn of the normal.
_OTHER_PLACE, _OTHER_DISTANCE, _OTHER_TILT_DEG = 0.12, 1.2, 12.0
_USUAL_FOCAL_WIDTHS = 1.1
_THIRDS = (("top left corner", "top edge", "top right corner"), ("left edge", "middle", "right edge"),
           ("bottom left corner", "bottom edge", "bottom right corner"))  # fmt: skip
_TILTS = (
    ("top", (0.0, 1.0)),
    ("bottom", (0.0, -1.0)),
    ("left side", (1.0, 0.0)),
    ("right side", (-1.0, 0.0)),
)


def usual_camera(size: tuple[int, int]) -> CameraIntrinsics:
    """A guess that is good enough to tell which way a board is tilted."""
    width, height = size
    focal = _USUAL_FOCAL_WIDTHS * max(size)
    matrix = np.array([[focal, 0.0, width / 2.0], [0.0, focal, height / 2.0], [0.0, 0.0, 1.0]])
    return CameraIntrinsics(matrix, np.zeros(5), size)


@dataclass(frozen=True, slots=True)
class Wish:
    """What a person should do next with the board.

    Attributes:
        code: for translation: `show-board`, `tilt-top`, `tilt-bottom`, `tilt-left`, `tilt-right` (that side
            away from the camera), `move-left`, `move-top-right` and so on, `move-nearer`, `move-further` or
            `another-way`.
        words: the same, as the end of a sentence.
        target: where in the picture the board should go, 0..1 from its top left corner; None for anywhere.
    """

    code: str
    words: str
    target: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Stance:
    """Roughly how a board was held.

    Attributes:
        corners: (N, 2) px.
        place: middle of the corners in widths of the picture.
        normal: (3,) of the board, away from the camera.
        distance: of its middle from the camera, mm as the guessed camera has it.
        oblique_deg: angle between its normal and the ray to its middle.
    """

    corners: Pixels
    place: Floats
    normal: Floats
    distance: float
    oblique_deg: float

    @classmethod
    def of(cls, seen: BoardObservation, size: tuple[int, int]) -> "Stance":
        pose = board_pose(usual_camera(size), seen.corners, seen.board_points).camera_from_board
        middle = (pose @ seen.board_points).mean(axis=0)
        normal = pose.rotation[:, 2] * (1.0 if pose.rotation[2, 2] > 0.0 else -1.0)
        oblique = np.degrees(np.arccos(np.clip(abs(float(normal @ unit(middle))), 0.0, 1.0)))
        return cls(
            seen.corners, seen.corners.mean(axis=0) / max(size), normal, float(np.linalg.norm(middle)),
            float(oblique),
        )  # fmt: skip

    @property
    def tilted_away(self) -> frozenset[str]:
        """Sides of the board that are clearly further from the camera than the others."""
        across = self.normal[:2]
        length = float(np.linalg.norm(across))
        if np.degrees(np.arcsin(min(length, 1.0))) < _ENOUGH_TILT_DEG:
            return frozenset()
        return frozenset(side for side, way in _TILTS if float(across @ way) > _SIDEWAYS * length)

    def is_like(self, other: "Stance") -> bool:
        """Whether a camera would learn little from one after the other."""
        turn = np.degrees(np.arccos(np.clip(float(self.normal @ other.normal), -1.0, 1.0)))
        ratio = max(self.distance, other.distance) / max(min(self.distance, other.distance), 1e-9)
        is_near = float(np.linalg.norm(self.place - other.place)) < _OTHER_PLACE
        return bool(is_near and turn < _OTHER_TILT_DEG and ratio < _OTHER_DISTANCE)


class Goals:
    """What the views should have shown when they are enough.

    Attributes:
        size: of the pictures.
        stances: of the views so far.
    """

    def __init__(self, size: tuple[int, int]) -> None:
        self.size = size
        self.stances: list[Stance] = []

    def add(self, stance: Stance) -> None:
        self.stances.append(stance)

    def gain(self, stance: Stance) -> str:
        """What one more view would add, in words; empty for nothing."""
        if any(stance.is_like(other) for other in self.stances):
            return ""
        before = self._coverage.counts > 0
        after = _coverage([stance], self.size).counts > 0
        new_cells = int(np.count_nonzero(after & ~before))
        if self._coverage.share < _ENOUGH_COVERAGE and new_cells:
            share = 100.0 * new_cells / before.size
            return f"{share:.0f} % more of the picture"
        new_tilts = [side for side, _ in _TILTS if side in stance.tilted_away - self._tilts]
        if new_tilts:
            return f"the {' and the '.join(new_tilts)} tilted away"
        distances = [other.distance for other in self.stances]
        if self._distances_ratio < _ENOUGH_DISTANCES:
            if stance.distance < min(distances):
                return "nearer than before"
            if stance.distance > max(distances):
                return "further away than before"
        return "another pose" if len(self.stances) < ENOUGH_VIEWS else ""

    @property
    def wanted(self) -> str:
        """What to do next, in words; empty when the views are enough."""
        wish = self.wish
        return "" if wish is None else wish.words

    @property
    def wish(self) -> Wish | None:
        """What to do next; None when the views are enough."""
        if not self.stances:
            words = "show the whole board to the camera, and hold it still for a moment"
            return Wish("show-board", words, (0.5, 0.5))
        missing = [side for side, _ in _TILTS if side not in self._tilts]
        # Two tilts first: without them nothing else is worth much.
        if len(missing) > 2:
            return _tilt(missing[0])
        if self._coverage.share < _ENOUGH_COVERAGE:
            return self._to_the_emptiest()
        if missing:
            return _tilt(missing[0])
        if self._distances_ratio < _ENOUGH_DISTANCES:
            sizes = [float(np.ptp(stance.corners[:, 0])) for stance in self.stances]
            if float(np.median(sizes)) < 0.5 * self.size[0]:
                return Wish("move-nearer", "hold the board nearer to the camera")
            return Wish("move-further", "hold the board further from the camera")
        if len(self.stances) < ENOUGH_VIEWS:
            return Wish("another-way", "hold the board another way: other place, other tilt")
        return None

    @property
    def done(self) -> float:
        """How near the views are to enough, 0..1."""
        parts = (
            self._coverage.share / _ENOUGH_COVERAGE,
            len(self._tilts) / len(_TILTS),
            (self._distances_ratio - 1.0) / (_ENOUGH_DISTANCES - 1.0),
            len(self.stances) / ENOUGH_VIEWS,
        )
        return float(np.mean([min(part, 1.0) for part in parts]))

    @property
    def coverage(self) -> float:
        """Share of the picture that the views reached, 0..1."""
        return self._coverage.share

    @property
    def counts(self) -> NDArray[np.intp]:
        """(rows, columns) corners in each cell of a coarse grid over the picture."""
        return self._coverage.counts

    @property
    def _coverage(self) -> Coverage:
        return _coverage(self.stances, self.size)

    @property
    def _tilts(self) -> frozenset[str]:
        return frozenset().union(*(stance.tilted_away for stance in self.stances))

    @property
    def _distances_ratio(self) -> float:
        distances = [stance.distance for stance in self.stances]
        return max(distances) / min(distances) if distances else 1.0

    def _to_the_emptiest(self) -> Wish:
        """Into the ninth of the picture with the largest share of cells without a corner."""
        empty = self._coverage.counts == 0
        rows, columns = empty.shape
        most, wish = -1.0, Wish("another-way", "hold the board another way")
        for row, names in enumerate(_THIRDS):
            for column, third in enumerate(names):
                part = empty[
                    rows * row // 3 : max(rows * (row + 1) // 3, rows * row // 3 + 1),
                    columns * column // 3 : max(columns * (column + 1) // 3, columns * column // 3 + 1),
                ]
                if float(np.mean(part)) > most:
                    most = float(np.mean(part))
                    target = (2 * column + 1) / 6.0, (2 * row + 1) / 6.0
                    wish = Wish(
                        f"move-{_code(third)}", f"bring the board to the {third} of the picture", target
                    )
        return wish


def _tilt(side: str) -> Wish:
    return Wish(f"tilt-{_code(side)}", f"tilt the {side} of the board away from the camera")


def _code(place: str) -> str:
    """`top left corner` as `top-left`, `left side` as `left`."""
    for end in (" corner", " edge", " side"):
        place = place.removesuffix(end)
    return place.replace(" ", "-")


def _coverage(stances: Sequence[Stance], size: tuple[int, int]) -> Coverage:
    return Coverage.of([stance.corners for stance in stances], size)
