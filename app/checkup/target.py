"""Something on the table whose places can be told apart: its markers, or the calibration board."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from app.devices.bench_file import BenchDescription
from app.geometry.arrays import Pixels
from app.vision.board import BoardSpec, detect_board
from app.vision.markers import PlatterSpec, detect_markers
from app.vision.stripe import Image

Corners: TypeAlias = Mapping[int, Pixels]
"""Places (n, 2) px by a number: four corners of a marker, or one corner of the board."""

_FEWEST_CORNERS = 8


@dataclass(frozen=True, slots=True)
class Target:
    """What is looked at while the table turns.

    Attributes:
        what: platter or board.
    """

    what: PlatterSpec | BoardSpec

    @property
    def name(self) -> str:
        """As a person would say it."""
        return "markers" if isinstance(self.what, PlatterSpec) else "calibration board"

    def find(self, image: Image) -> Corners:
        """Where its places are; empty where it is not seen well enough to measure by."""
        if isinstance(self.what, PlatterSpec):
            seen = detect_markers(image, self.what)
            corners = {int(n): quad for n, quad in zip(seen.ids, seen.corners, strict=True)}
        else:
            board = detect_board(image, self.what)
            corners = {int(n): corner[None] for n, corner in zip(board.ids, board.corners, strict=True)}
        return corners if sum(len(places) for places in corners.values()) >= _FEWEST_CORNERS else {}


def targets_of(description: BenchDescription) -> tuple[Target, ...]:
    """What a bench has to look at, the better first."""
    specs = [entry.spec() for entry in (description.platter, description.board) if entry is not None]
    return tuple(Target(spec) for spec in specs)


def in_common(one: Corners, other: Corners) -> tuple[Pixels, Pixels, list[int]]:
    """The places seen in both pictures, (N, 2) and (N, 2), and their numbers."""
    numbers = sorted(number for number in one.keys() & other.keys() if len(one[number]) == len(other[number]))
    if not numbers:
        return np.zeros((0, 2)), np.zeros((0, 2)), []
    return np.concatenate([one[n] for n in numbers]), np.concatenate([other[n] for n in numbers]), numbers
