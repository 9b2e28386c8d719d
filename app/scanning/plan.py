"""What a scan is to do."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from app.documents import Entry
from app.recording.shot import Role

Mode = Literal["step", "continuous"]
_RUN_IN_S = 1.0


class ScanPlan(Entry):
    """A scan, as it is kept beside its recording.

    Attributes:
        mode: `step` stops for every picture; `continuous` turns steadily, once for each laser.
        lasers: names, in the order in which they scan.
        steps: stops in one turn.
        turn_deg: how far the table turns in all.
        with_dark: a picture with the lasers off at every stop, with the laser's exposure: what the stripe's
            picture is compared with. In a continuous scan, one turn with the lasers off, for the colour.
        texture_every: at every n-th stop a picture with the exposure for texture; 0 for none.
        seconds_per_turn: of a continuous scan.
        together: all lasers are lit in one picture: half the time with two, where their stripes do not cross.
    """

    mode: Mode = "step"
    lasers: Annotated[tuple[str, ...], Field(min_length=1)]
    steps: Annotated[int, Field(ge=1, le=100_000)] = 200
    turn_deg: Annotated[float, Field(gt=0.0, le=3600.0)] = 360.0
    with_dark: bool = True
    texture_every: Annotated[int, Field(ge=0)] = 0
    seconds_per_turn: Annotated[float, Field(gt=0.0, le=86_400.0)] = 30.0
    together: bool = False

    def angle_deg(self, stop: int) -> float:
        """Where a stop is."""
        return self.turn_deg * stop / self.steps

    def looks(self, stop: int) -> "tuple[Look, ...]":
        """What is photographed at a stop of a step scan, in order."""
        looks = [Look(Role.TEXTURE, ())] if self.with_dark else []
        looks += self._lit
        if self.texture_every and stop % self.texture_every == 0:
            looks.append(Look(Role.TEXTURE, (), for_colour=True))
        return tuple(looks)

    @property
    def passes(self) -> "tuple[Look, ...]":
        """The turns of a continuous scan, in order."""
        looks = [Look(Role.TEXTURE, ())] if self.with_dark else []
        return (*looks, *self._lit)

    @property
    def _lit(self) -> "tuple[Look, ...]":
        groups = [self.lasers] if self.together else [(laser,) for laser in self.lasers]
        return tuple(Look(Role.SCAN, lasers) for lasers in groups)

    @property
    def shots(self) -> int:
        """How many pictures a step scan takes."""
        return sum(len(self.looks(stop)) for stop in range(self.steps))

    @property
    def speed_deg_s(self) -> float:
        """Of a continuous scan."""
        return 360.0 / self.seconds_per_turn

    @property
    def run_in_deg(self) -> float:
        """How far a continuous scan turns before its first picture, while the table gathers speed."""
        return float(np.ceil(self.speed_deg_s * _RUN_IN_S))


@dataclass(frozen=True, slots=True)
class Look:
    """One picture of a stop, or one turn of a continuous scan.

    Attributes:
        role: in the recording.
        lasers: that are lit.
        for_colour: exposed for texture rather than for the laser.
    """

    role: Role
    lasers: tuple[str, ...]
    for_colour: bool = False

    @property
    def key(self) -> str:
        """What it is called in the recording, so that a scan that goes on knows what it has."""
        return "colour" if self.for_colour else "+".join(self.lasers) or "dark"
