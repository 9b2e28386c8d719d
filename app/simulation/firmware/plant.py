"""The machine that a board drives: one motor with its table, and laser outputs, as functions of time."""

import math
import threading
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field

from app.simulation.firmware.motion import Motion

_KEPT_S = 10.0


@dataclass(frozen=True, slots=True)
class Wiring:
    """How the machine is put together, which its board does not know.

    Attributes:
        steps_per_turn: of the table, counted in the board's pulses; negative for a motor that is wired the
            other way round.
        play_deg: the table stays behind by as much after the motor has turned round.
        lasers: name of the laser at each output.
    """

    steps_per_turn: float
    play_deg: float = 0.0
    lasers: Mapping[int, str] = field(default_factory=lambda: {0: "left", 1: "right"})


@dataclass(frozen=True, slots=True)
class PlantState:
    """The machine at one moment.

    Attributes:
        angle_deg: of the table since power came on, counter-clockwise seen from above.
        outputs_on: the laser outputs that are on.
        is_moving: whether the motor turns.
        is_holding: whether the motor holds the table.
    """

    angle_deg: float
    outputs_on: frozenset[int]
    is_moving: bool
    is_holding: bool


@dataclass(frozen=True, slots=True)
class Event:
    """Something a wire did.

    Attributes:
        time_s: when.
        what: `laser on`, `laser off`, `driver on`, `driver off`, `move` or `slip`.
        output: number of the laser output.
        steps: how far a move goes, steps; how far the table slips, degrees.
    """

    time_s: float
    what: str
    output: int = 0
    steps: float = 0.0


class Plant:
    """Motor, table and laser outputs. The board writes, cameras and tests read; safe from several threads.

    Times are those of the simulated world, seconds. What happened is kept for some seconds, so that the
    machine can be asked how it stood when a picture was exposed.

    Attributes:
        wiring: how it is put together.
        events: what the wires did, oldest first; the last some thousand.
    """

    def __init__(self, wiring: Wiring) -> None:
        self.wiring = wiring
        self.events: deque[Event] = deque(maxlen=5000)
        self._lock = threading.RLock()
        self._moves: deque[tuple[Motion, bool]] = deque()
        self._stood = _Stance(0.0, 0.0)
        self._slips: list[tuple[float, float]] = []
        self._outputs: deque[tuple[float, frozenset[int]]] = deque([(-math.inf, frozenset())])
        self._is_holding = False

    def move(self, motion: Motion, *, is_coupled: bool = True) -> None:
        """The board begins a move; `is_coupled` is False where pulses go to a motor without current."""
        with self._lock:
            while self._moves and self._moves[0][0].end_s < motion.start_s - _KEPT_S:
                self._stood = self._stood.after(*self._moves.popleft(), math.inf, self.wiring)
            self._moves.append((motion, is_coupled))
            self.events.append(Event(motion.start_s, "move", steps=motion.steps))

    def replan(self, motion: Motion) -> None:
        """The move under way becomes this one, which began the same: it was held, or broken off."""
        with self._lock:
            _, is_coupled = self._moves.pop()
            self._moves.append((motion, is_coupled))

    def switch(self, output: int, is_on: bool, time_s: float) -> None:
        """Put a laser output on or off."""
        with self._lock:
            was = self._outputs[-1][1]
            now = was | {output} if is_on else was - {output}
            if now == was:
                return
            self._outputs.append((time_s, now))
            while len(self._outputs) > 2 and self._outputs[1][0] < time_s - _KEPT_S:
                self._outputs.popleft()
            self.events.append(Event(time_s, "laser on" if is_on else "laser off", output))

    def hold(self, is_holding: bool, time_s: float) -> None:
        """Give the motor current, or let it go."""
        with self._lock:
            if is_holding != self._is_holding:
                self._is_holding = is_holding
                self.events.append(Event(time_s, "driver on" if is_holding else "driver off"))

    def slip(self, angle_deg: float, time_s: float) -> None:
        """The table jumps without the board knowing: lost steps, or a hand."""
        with self._lock:
            self._slips.append((time_s, angle_deg))
            self.events.append(Event(time_s, "slip", steps=angle_deg))

    def at(self, time_s: float) -> PlantState:
        """The machine at a time, now or within the last seconds."""
        with self._lock:
            on = next(on for since, on in reversed(self._outputs) if since <= time_s)
            stance = self._stood
            for motion, is_coupled in self._moves:
                stance = stance.after(motion, is_coupled, time_s, self.wiring)
            slipped = sum(angle for since, angle in self._slips if since <= time_s)
            is_moving = any(motion.start_s <= time_s < motion.end_s for motion, _ in self._moves)
            return PlantState(stance.table_deg + slipped, on, is_moving, self._is_holding)

    def shares_on(self, start_s: float, end_s: float) -> dict[int, float]:
        """Outputs that were on between two times, each with the share of that time; ends in the past."""
        with self._lock:
            outputs = tuple(self._outputs)
        shares: dict[int, float] = {}
        ends = [since for since, _ in outputs[1:]] + [math.inf]
        for (since, on), until in zip(outputs, ends, strict=True):
            lit_s = min(until, end_s) - max(since, start_s)
            if lit_s > 0.0:
                for output in on:
                    shares[output] = shares.get(output, 0.0) + lit_s / (end_s - start_s)
        return shares

    def lasers_on(self, time_s: float) -> tuple[str, ...]:
        """Names of the lasers that are lit, by the wiring."""
        on = self.at(time_s).outputs_on
        return tuple(name for output, name in self.wiring.lasers.items() if output in on)


@dataclass(frozen=True, slots=True)
class _Stance:
    motor_deg: float
    table_deg: float

    def after(self, motion: Motion, is_coupled: bool, time_s: float, wiring: Wiring) -> "_Stance":
        """Where a move has brought both by a time; beyond the play the motor takes the table along."""
        if not is_coupled:
            return self
        turned = 360.0 * (motion.position_at(time_s) - motion.from_steps) / wiring.steps_per_turn
        motor = self.motor_deg + turned
        return _Stance(motor, min(max(self.table_deg, motor - wiring.play_deg), motor))
