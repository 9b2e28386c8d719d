"""What a scan is to do."""

from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from app.documents import Entry
from app.recording.shot import Role

Mode = Literal["step", "continuous"]
MOST_EXPOSURES = 8
LONGEST_EXPOSURE_US = 10e6
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
        exposures_us: of a step scan: every picture with a laser, and its partner without, is taken with each
            of these, microseconds; none for the one exposure that the camera has for the laser.
    """

    mode: Mode = "step"
    lasers: Annotated[tuple[str, ...], Field(min_length=1)]
    steps: Annotated[int, Field(ge=1, le=100_000)] = 200
    turn_deg: Annotated[float, Field(gt=0.0, le=3600.0)] = 360.0
    with_dark: bool = True
    texture_every: Annotated[int, Field(ge=0)] = 0
    seconds_per_turn: Annotated[float, Field(gt=0.0, le=86_400.0)] = 30.0
    together: bool = False
    exposures_us: Annotated[
        tuple[Annotated[float, Field(gt=0.0, le=LONGEST_EXPOSURE_US)], ...], Field(max_length=MOST_EXPOSURES)
    ] = ()

    def angle_deg(self, stop: int) -> float:
        """Where a stop is."""
        return self.turn_deg * stop / self.steps

    def looks(self, stop: int) -> "tuple[Look, ...]":
        """What is photographed at a stop of a step scan, in order."""
        looks = list(self.passes)
        if self.exposures_us:
            # Longest first: the first picture without a laser is the one that colours are taken from.
            longest_first = sorted(self.exposures_us, reverse=True)
            looks = [replace(look, exposure_us=each) for each in longest_first for look in looks]
        if self.texture_every and stop % self.texture_every == 0:
            looks.append(Look(Role.TEXTURE, (), for_colour=True))
        return tuple(looks)

    @property
    def passes(self) -> "tuple[Look, ...]":
        """The turns of a continuous scan, in order."""
        dark = [Look(Role.TEXTURE, ())] if self.with_dark else []
        groups = [self.lasers] if self.together else [(laser,) for laser in self.lasers]
        return (*dark, *(Look(Role.SCAN, lasers) for lasers in groups))

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
        exposure_us: of a stack; None for the exposure of its use.
    """

    role: Role
    lasers: tuple[str, ...]
    for_colour: bool = False
    exposure_us: float | None = None

    @property
    def key(self) -> str:
        """What it is called in the recording, so that a scan that goes on knows what it has."""
        shown = "colour" if self.for_colour else "+".join(self.lasers) or "dark"
        return shown if self.exposure_us is None else f"{shown}@{self.exposure_us:g}"
