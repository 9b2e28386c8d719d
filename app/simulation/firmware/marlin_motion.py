"""How Marlin turns coordinates into pulses: what it counts and believes, and what keeps it from moving."""

import math
from collections.abc import Mapping

from app.simulation.firmware.planner import Block, Planner
from app.simulation.firmware.plant import Plant

X, E = 0, 1
AXES = "XE"
_BLOCKS = 15
# The step timer of an 8-bit board makes no fewer pulses per second.
_SLOWEST_STEPS_S = 32.0
_BED_MM = 200.0
_LONGEST_EXTRUSION_MM = 200.0
# A pressed switch is noticed after the first pulse, and the block is broken off after the second.
_PULSES_AGAINST_SWITCH = 2


class MarlinMotion:
    """Coordinates, steps and limits of the table's axis and the extruder.

    Attributes:
        planner: the queue of blocks.
        per_mm: steps per unit of each axis.
        fastest: units/s of each axis; acceleration: units/s², of all.
        at: where each axis will be when all moves are done, units.
        are_endstops_on: whether switches stop a move; those at the low end read as pressed, as nothing is
            connected.
    """

    def __init__(self, plant: Plant, table_axis: str, *, has_slow_timer: bool) -> None:
        self.planner = Planner(plant, AXES.index(table_axis), len(AXES), _BLOCKS)
        self._has_slow_timer = has_slow_timer
        self.forget(are_endstops_on=False)

    def forget(self, *, are_endstops_on: bool) -> None:
        """As after a reset: what was set, and where everything is."""
        self.per_mm, self.fastest, self.acceleration = [80.2, 96.0], [400.0, 25.0], 3000.0
        self.at = [0.0, 0.0]
        self.is_relative = [False, False]
        self.are_endstops_on, self.is_bed_limited, self.may_extrude_cold = are_endstops_on, True, False
        self._feed = 25.0
        self._planned, self._count_zero = [0, 0], [0, 0]
        self.planner.forget()

    def count(self, axis: int, now_s: float) -> int:
        """Pulses given to an axis since it was last told where it is."""
        return self.planner.position(now_s)[axis] - self._count_zero[axis]

    def move(self, words: Mapping[str, float], now_s: float) -> str:
        """Queue a move by the words of a G1; what the board says of it besides `ok`, in front and behind."""
        if words.get("F", 0.0) > 0.0:
            self._feed = words["F"] / 60.0
        begin = list(self.at)
        for axis, letter in enumerate(AXES):
            if letter in words:
                self.at[axis] = words[letter] + (begin[axis] if self.is_relative[axis] else 0.0)
        if self.is_bed_limited and "X" in words:
            self.at[X] = min(max(self.at[X], 0.0), _BED_MM)
        refusal = self._refused_extrusion(self.at[E] - begin[E])
        if refusal:
            self._planned[E] = self._steps(E)
        steps = [self._steps(axis) - self._planned[axis] for axis in (X, E)]
        self._planned = [self._steps(axis) for axis in (X, E)]
        if self.are_endstops_on and steps[X] < 0:
            self._queue((-_PULSES_AGAINST_SWITCH, 0), 1.0, self.per_mm[X], now_s)
            noticed = self.planner.target[X] - self._count_zero[X] + 1
            return f"ok\necho:endstops hit:  X:{noticed / self.per_mm[X]:.2f}\n"
        if any(steps):
            main = max((X, E), key=lambda axis: abs(steps[axis]))
            length = abs(steps[main]) / self.per_mm[main]
            slowest = _SLOWEST_STEPS_S / self.per_mm[main] if self._has_slow_timer else 0.0
            speed = max(min(self._feed, self.fastest[main]), slowest)
            self._queue((steps[X], steps[E]), length, speed, now_s)
        return refusal + "ok\n"

    def settle(self, axis: int, units: float, now_s: float) -> None:
        """The axis is told where it stands, or what a step is."""
        self.at[axis] = units
        self._planned[axis] = self._steps(axis)
        self._count_zero[axis] = self.planner.position(now_s)[axis] - self._planned[axis]

    def stop(self, now_s: float) -> None:
        """Stop at once; the table's axis is where its pulses say, the extruder where it should have gone."""
        self.planner.cut(now_s)
        self.settle(X, self.count(X, now_s) / self.per_mm[X], now_s)
        self.settle(E, self.at[E], now_s)

    def _refused_extrusion(self, length: float) -> str:
        """Why filament may not be moved; the firmware counts on as if it had been."""
        if not length:
            return ""
        if not self.may_extrude_cold:
            # The coordinates and the planner each say so.
            return "echo: cold extrusion prevented\n" * 2
        return "echo: too long extrusion prevented\n" if abs(length) > _LONGEST_EXTRUSION_MM else ""

    def _queue(self, steps: tuple[int, int], length: float, speed: float, now_s: float) -> None:
        self.planner.add(Block(self.planner.target, steps, length, speed, self.acceleration), now_s)
        if not self.planner.is_moving(now_s):
            self.planner.start(now_s)

    def _steps(self, axis: int) -> int:
        return math.floor(self.at[axis] * self.per_mm[axis] + 0.5)
