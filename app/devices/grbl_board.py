"""A Grbl board as a turntable wants it: on its feet, set up, place known, lasers as they were asked for."""

import contextlib
import threading
import time
from collections.abc import Callable
from typing import TypeVar

from app.devices.bearings import Bearings
from app.devices.grbl_dialogue import (
    ANSWER_S,
    BoardAlarmed,
    BoardLocked,
    BoardRestarted,
    GrblDialogue,
    GrblStatus,
)
from app.devices.grbl_setup import GrblAxis, GrblSetup, is_other, keeps_current
from app.devices.laser_care import LASER_ANSWER_S, dark_unless_answered
from app.devices.refusals import resets_again
from app.devices.serial_link import SerialLink
from app.devices.turntable import SteadyTurn
from app.errors import DeviceError, DeviceRefused

T = TypeVar("T")

AXES = "XYZA"
LASERS = (1, 2)
BUSY_WAIT_S = 120.0
LOOK_S = 0.05
_TRIES = 4
_ALARMS = {1: "a limit switch closed", 2: "the angle is beyond the travel that is set"}


class GrblBoard:
    """All that belongs into a dialogue, but for moves.

    Attributes:
        dialogue: request and answer.
        bearings: where the table stands; the board counts steps.
        axis: the table's, as the board is set.
        turn: the steady turn under way.
        lit: lasers that are on, or perhaps are.
        is_asleep: whether it must be woken first.
        has_current: whether the motor holds the table.
        halted: set when a steady turn has been stopped, or the board was lost.
    """

    def __init__(
        self, link: SerialLink, bearings: Bearings, setup: GrblSetup, power: float, halted: threading.Event
    ) -> None:
        self.dialogue, self.bearings, self.halted = GrblDialogue(link), bearings, halted
        self.axis = GrblAxis()
        self.turn: SteadyTurn | None = None
        self.lit: set[int] = set()
        self.is_asleep = self.has_current = self._was_met = False
        self._link, self._setup, self._power = link, setup, power

    def do(self, action: Callable[[], T]) -> T:
        """As `do_awake`, with a board that is brought to its feet first."""

        def awake() -> T:
            if self.is_asleep:
                self.energise()
            if not self.dialogue.is_in_step:
                self.find_out()
            return action()

        return self.do_awake(awake)

    def do_awake(self, action: Callable[[], T]) -> T:
        """Do something, again where the board has begun anew or was locked.

        Raises:
            PositionUnknown: it was turning when it began anew.
            DeviceError: an alarm stopped the table.
        """
        for _ in range(_TRIES):
            try:
                return action()
            except BoardRestarted:
                with contextlib.suppress(BoardRestarted):
                    self._begin_anew()
            except BoardAlarmed as alarm:
                self._recover(alarm.number)
            except BoardLocked:
                self.dialogue.unlock()
        raise resets_again(self._link.device)

    def come_up(self) -> None:
        """Behind a port that was just opened: on its feet, set up, lasers off, position found.

        Raises:
            PositionUnknown: the table was turning when the board was lost.
        """
        self.turn, self.is_asleep, self.has_current = None, False, False
        was_reset = self.dialogue.greet()
        self.lit.clear()
        for _ in range(_TRIES):
            try:
                self._set_up(self._settle())
                self._make_ready()
                at = self._counted(self.dialogue.status())
                break
            except BoardRestarted:
                was_reset = True
            except BoardAlarmed:
                self.dialogue.reset_after_alarm()
            except BoardLocked:
                self.dialogue.unlock()
        else:
            raise resets_again(self._link.device)
        is_new_scale = self.axis.per_deg != self.bearings.per_deg
        if self._was_met and not was_reset and not is_new_scale:
            self.bearings.arrive(at)
        else:
            self.bearings.count_anew(at, self.axis.per_deg)
            self.bearings.lose()
        self._was_met = True

    def find_out(self) -> None:
        """Where the table stands, once it does."""
        status = self.dialogue.status()
        if status.state != "Idle":
            status = self._settle()
            self._make_ready()
        self.dialogue.get_in_step()
        self.bearings.arrive(self._counted(status))
        self.turn = None

    def look(self) -> GrblStatus:
        """How it is, whatever it does."""
        status = self.dialogue.status()
        self.is_asleep = status.state == "Sleep"
        if status.state == "Alarm":
            raise BoardLocked
        return status

    def arrived(self, status: GrblStatus) -> None:
        """The table stands where the board says."""
        self.bearings.arrive(self._counted(status))

    def halt(self) -> None:
        """The clean way to stop: brakes, wait until it stands, reset. The count is exact, lasers go off."""
        self._link.write(b"!")
        brake_s = self.axis.fastest_deg_s / self.axis.acceleration_deg_s2
        ends_s = time.monotonic() + ANSWER_S + brake_s
        while (status := self.dialogue.status()).is_moving and time.monotonic() < ends_s:
            time.sleep(LOOK_S / 5.0)
        self.lit.clear()
        self.turn = None
        if status.state != "Sleep":
            self.dialogue.reset()
            status = self._settle()
            self._make_ready()
        self.arrived(status)
        self.halted.set()

    def switch(self, channel: int, is_on: bool, extra_s: float = 0.0) -> None:
        """Put a laser on or off; out, where the board does not answer.

        Args:
            extra_s: it answers so much later, as it switches only while the table stands.
        """
        on, off = {1: (f"M3 S{number(self._power)}", "M5"), 2: ("M8", "M9")}[channel]
        if is_on:
            # Counted as lit from before the command.
            self.lit.add(channel)
        try:
            with dark_unless_answered(self._link, f"{off}\n".encode()):
                self.dialogue.request(on if is_on else off, LASER_ANSWER_S + extra_s)
        except DeviceError:
            self.lit.discard(channel)
            raise
        if not is_on:
            self.lit.discard(channel)

    def energise(self) -> None:
        """Current on: with $1=255 the board's start does it, and it ends its sleep."""
        if self.has_current and not self.is_asleep:
            return
        self.dialogue.reset()
        self.is_asleep, self.has_current = False, True
        self.bearings.at = self._counted(self._settle())
        self._make_ready()

    def sleep(self) -> None:
        """Current and lasers off."""
        self.dialogue.request("$SLP")
        self.is_asleep, self.has_current = True, False
        self.lit.clear()

    def say(self, line: str) -> str:
        """A line that somebody typed, and its answer."""
        if line in ("?", "!", "~"):
            self._link.discard()
            self._link.write(line.encode())
            return self._link.listen(0.3).decode("ascii", "replace").strip()
        said = self.dialogue.request(line, BUSY_WAIT_S)
        self.bearings.at = self._counted(self._settle())
        return "\n".join([*said, "ok"])

    @property
    def speed_deg_s(self) -> float:
        """Of moves."""
        return min(self._setup.speed_deg_s or self.axis.fastest_deg_s, self.axis.fastest_deg_s)

    def _settle(self) -> GrblStatus:
        """Wait for the end of a move; leave hold, sleep and alarm."""
        ends_s = time.monotonic() + BUSY_WAIT_S
        while (status := self.dialogue.status()).is_moving and time.monotonic() < ends_s:
            time.sleep(LOOK_S)
        if status.state != "Idle":
            if status.state != "Alarm":
                self.dialogue.reset()
            self.dialogue.unlock()
            status = self.dialogue.status()
        self.is_asleep = False
        self.dialogue.get_in_step()
        return status

    def _set_up(self, status: GrblStatus) -> None:
        """Learn the board's settings, and write those that have to be others."""
        name = self._link.device
        if len(status.machine) <= self._setup.axis:
            raise DeviceRefused(name, f"has no axis {AXES[self._setup.axis]}", "Set `axis` to one it has.")
        known = self.dialogue.settings()
        changes = self._setup.changes(name, known)
        self.has_current = self.has_current or keeps_current(known)
        for setting, value in changes.items():
            if is_other(known, setting, value):
                self.dialogue.request(f"${setting}={number(value)}")
        # The board shows three decimals of what it was told.
        is_hal = self.dialogue.firmware.startswith("grblHAL")
        self.axis = self._setup.axis_of(name, known | changes, has_slow_timer=not is_hal)
        self.dialogue.units_per_inch = self.axis.units_per_inch

    def _make_ready(self) -> None:
        """What every start of the board forgets, and lasers as they should be."""
        self.dialogue.request(f"G21 G90 G94 F{number(60.0 * self.speed_deg_s)}")
        for channel in LASERS:
            self.switch(channel, channel in self.lit)

    def _begin_anew(self) -> None:
        """The board has reset itself. Its count begins at what it says; the angle is kept where it stood."""
        self.turn, self.is_asleep, self.has_current = None, False, True
        status = self._settle()
        self._make_ready()
        self.bearings.count_anew(self._counted(status))
        if self.bearings.way is not None:
            self.lit.clear()
            raise self.bearings.lost()

    def _recover(self, alarm: int) -> None:
        """From an alarm; the board has counted its pulses up to there."""
        was_moving, self.turn = self.bearings.way is not None, None
        self.lit.clear()
        self.dialogue.reset_after_alarm()
        status = self._settle()
        self._make_ready()
        self.arrived(status)
        if was_moving:
            raise DeviceError(
                self._link.device,
                f"stopped at {self.bearings.angle_deg:.2f} degrees with alarm {alarm} "
                f"({_ALARMS.get(alarm, 'reset')})",
                "A turntable needs no limits: set $20=0 and $21=0 on the board.",
            )

    def _counted(self, status: GrblStatus) -> int:
        return round(status.machine[self._setup.axis] * self.axis.per_deg)


def number(value: float) -> str:
    """As Grbl reads it: at most five decimals, no exponent."""
    return f"{value:.5f}".rstrip("0").rstrip(".")
