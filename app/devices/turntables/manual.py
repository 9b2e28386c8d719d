"""No board at all: a person turns the table, or it turns by itself, as a record player does."""

import math
import threading
import time
from collections.abc import Callable, Sequence

from app.devices.turntable import TURNTABLES, Farewell, SteadyTurn, TurntableFacts
from app.errors import DeviceError, DeviceRefused, MoveStopped


class ManualTurntable:
    """A table without a board.

    With `seconds_per_turn` 0 a person turns it and confirms each stop. Otherwise it turns all the time at
    that speed; then it cannot be told where to go, and its angle is the time since `connect`, or `zero`.

    Attributes:
        name: what messages call it.
        seconds_per_turn: how long a turn takes where the table turns by itself, negative for clockwise; 0
            where a person turns it.
        laser_channels: numbers of the lasers.
        are_lasers_always_on: whether nobody switches them; asked to, the table does nothing. Otherwise the
            person is asked.
        smallest_deg: how finely the person can set the table by its scale.
        ask: is given a sentence that says what to do, and returns when it is done. Whoever builds the table
            for a person at a keyboard sets it.
    """

    def __init__(
        self,
        name: str = "turntable",
        seconds_per_turn: float = 0.0,
        laser_channels: Sequence[int] = (1, 2),
        are_lasers_always_on: bool = False,
        smallest_deg: float = 1.0,
        ask: Callable[[str], None] | None = None,
    ) -> None:
        if not math.isfinite(seconds_per_turn):
            raise DeviceRefused(name, "seconds_per_turn must be a number of seconds, or 0")
        if not smallest_deg > 0.0:
            raise DeviceRefused(name, "smallest_deg must be positive")
        self.name, self.seconds_per_turn, self.smallest_deg = name, seconds_per_turn, smallest_deg
        self.laser_channels, self.are_lasers_always_on = tuple(laser_channels), are_lasers_always_on
        self.ask = ask
        self._is_connected = False
        self._angle_deg = 0.0
        self._zero_s = time.monotonic()
        self._turn_ends_s = 0.0
        self._stopped = threading.Event()
        self._lit: set[int] = set()

    @property
    def facts(self) -> TurntableFacts:
        speed = abs(self._speed_deg_s)
        return TurntableFacts(
            f"turns by itself in {abs(self.seconds_per_turn):g} s" if speed else "turned by hand",
            "",
            self.laser_channels,
            self.smallest_deg,
            slowest_deg_s=speed,
            fastest_deg_s=speed,
            can_turn_steadily=speed > 0.0,
            tells_position=speed > 0.0,
            can_stop=False,
            turns_by_itself=speed > 0.0,
            lasers_by_hand=not self.are_lasers_always_on,
        )

    @property
    def angle_deg(self) -> float:
        turned_s = time.monotonic() - self._zero_s if self._speed_deg_s else 0.0
        return self._angle_deg + self._speed_deg_s * turned_s

    @property
    def farewell(self) -> Farewell | None:
        return None

    @property
    def is_connected(self) -> bool:
        return self._is_connected

    def connect(self) -> None:
        if not self._is_connected and self._speed_deg_s:
            self.zero(0.0)
        self._is_connected = True

    def disconnect(self) -> None:
        self.make_safe()
        self._is_connected = False

    def move_to(self, angle_deg: float) -> float:
        if self._speed_deg_s:
            raise DeviceRefused(
                self.name,
                "turns by itself and cannot be sent to an angle",
                "Scan continuously, or set seconds_per_turn to 0 and turn the table by hand.",
            )
        asked = round(angle_deg / self.smallest_deg) * self.smallest_deg
        if asked != self._angle_deg:
            self._stopped.clear()
            self._have_done(f"Turn the table to {asked:g} degrees, then confirm.")
            self._angle_deg = asked
            if self._stopped.is_set():
                raise MoveStopped(self.name, f"the table was turned to {asked:g} degrees, and no further")
        return asked

    def start_turning(self, angle_deg: float, speed_deg_s: float) -> SteadyTurn:
        """The table turns already; its speed is what it is, and so is its direction."""
        if not self._speed_deg_s:
            raise DeviceRefused(
                self.name,
                "is turned by hand, step by step",
                "Scan in steps, or set seconds_per_turn where it turns by itself.",
            )
        self._stopped.clear()
        from_deg, started_s = self.angle_deg, time.monotonic()
        duration_s = abs(angle_deg / self._speed_deg_s)
        self._turn_ends_s = started_s + duration_s
        to_deg = from_deg + math.copysign(angle_deg, self._speed_deg_s)
        return SteadyTurn(from_deg, to_deg, self._speed_deg_s, started_s, 0.0, duration_s)

    def finish_turning(self) -> float:
        if self._stopped.wait(max(0.0, self._turn_ends_s - time.monotonic())):
            raise MoveStopped(self.name, "nobody waits for the turn any more; the table turns on by itself")
        return self.angle_deg

    def position_now(self) -> float | None:
        return self.angle_deg if self._speed_deg_s else None

    def stop(self) -> float:
        """Nobody can hold the table but the person; whoever waits for it is told."""
        self._stopped.set()
        return self.angle_deg

    def zero(self, angle_deg: float = 0.0) -> None:
        self._angle_deg, self._zero_s = angle_deg, time.monotonic()

    def set_laser(self, channel: int, is_on: bool) -> None:
        if channel not in self.laser_channels:
            raise DeviceRefused(
                self.name,
                f"knows no laser {channel}",
                "List it in laser_channels, or take it out of the bench file.",
            )
        if not self.are_lasers_always_on and is_on != (channel in self._lit):
            self._have_done(f"Switch laser {channel} {'on' if is_on else 'off'}, then confirm.")
            (self._lit.add if is_on else self._lit.discard)(channel)

    def hold(self, is_holding: bool) -> None:
        """There is no motor."""

    def make_safe(self) -> None:
        """Asks nobody: a person who is away must not keep a program from ending."""
        self._stopped.set()

    def talk(self, line: str) -> str:
        raise DeviceRefused(self.name, "has no board to talk to", "Choose a driver of a board.")

    @property
    def _speed_deg_s(self) -> float:
        return 360.0 / self.seconds_per_turn if self.seconds_per_turn else 0.0

    def _have_done(self, what: str) -> None:
        if self.ask is None:
            raise DeviceError(
                self.name, "there is nobody to ask", "Start the command in a terminal, or choose a board."
            )
        self.ask(what)


TURNTABLES.register("manual", ManualTurntable)
