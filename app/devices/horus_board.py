"""A Horus board as a turntable wants it: at rest, in step, lasers and motor as they were asked for."""

import contextlib
import math
import time
from dataclasses import dataclass

from app.devices.bearings import Bearings
from app.devices.horus_kind import HorusKind, TrueHorus
from app.devices.horus_line import BANNER, REPLY_S, BoardRestarted, HorusLine
from app.devices.laser_care import dark_unless_answered
from app.devices.serial_link import SerialLink
from app.errors import DeviceRefused, PositionUnknown


@dataclass(frozen=True, slots=True)
class HorusTurn:
    """A steady turn under way.

    Attributes:
        line: that began it.
        goal: where it ends, as the board counts.
        ends_s: monotonic time by which its answer has come.
    """

    line: str
    goal: float
    ends_s: float


class HorusBoard:
    """What is done in a dialogue, but for whole moves.

    Attributes:
        line: request and answer.
        kind: what it can do.
        bearings: where the table stands; the board counts degrees.
        turn: the steady turn under way.
        is_holding: whether the motor shall have current.
        lit_since_s: monotonic time at which each laser that is on was switched last.
    """

    def __init__(self, link: SerialLink, bearings: Bearings) -> None:
        self.line, self.bearings = HorusLine(link), bearings
        self.kind: HorusKind = TrueHorus()
        self.turn: HorusTurn | None = None
        self.is_holding = False
        self.lit_since_s: dict[int, float] = {}

    @property
    def words_off(self) -> bytes:
        """What puts every laser out."""
        return b"".join(b"M70T%d\n" % channel for channel in self.kind.laser_channels)

    @property
    def oldest_s(self) -> float:
        """When the laser that has been on for longest was switched; infinite for none."""
        return min(tuple(self.lit_since_s.values()), default=math.inf)

    def meet(self) -> None:
        """Find out where the table stands, and put the lasers out."""
        self.lit_since_s.clear()
        self.turn = None
        self.line.is_in_step = False
        with contextlib.suppress(PositionUnknown):
            self.settle()
        self.put_out()

    def settle(self) -> None:
        """Nothing under way and no answer outstanding; a restart meanwhile noticed.

        Raises:
            PositionUnknown: the board was lost or has restarted in mid-move, as is found out now.
        """
        was_known = self.bearings.is_known
        self.finish()
        try:
            if BANNER.search(self.line.link.discard()) or self.line.has_restarted:
                raise BoardRestarted(self.line.link.device)
            if not self.line.is_in_step or self.bearings.way is not None:
                self._come_to_rest()
        except BoardRestarted:
            self._recover()
        if was_known:
            self.bearings.require_known()

    def finish(self) -> None:
        """Wait for the end of the steady turn, if there is one."""
        turn, self.turn = self.turn, None
        if turn is not None and not self.line.has_restarted:
            self.answer(turn.line, turn.goal, max(REPLY_S, turn.ends_s - time.monotonic()))

    def begin_anew(self) -> None:
        """The board has been reset and counts from 0; the table stands where it stood."""
        self.line.has_told_feed = self.line.has_restarted = False
        self.bearings.count_anew()
        self.bearings.lose()
        self.turn = None

    def command(self, line: str) -> None:
        """One line while the table stands; once more where the board had just started anew."""
        try:
            self.line.request(line)
        except BoardRestarted:
            self._recover()
            self.line.request(line)

    def set_out(self, line: str, goal: float) -> bool:
        """Begin a move. False where the board has started anew before: the place has another number now."""
        try:
            self.line.send(line)
        except BoardRestarted:
            self._recover()
            return False
        self.bearings.set_out(goal)
        return True

    def answer(self, line: str, goal: float, timeout_s: float) -> None:
        """Wait for the end of a move.

        Raises:
            PositionUnknown: the board has started anew.
        """
        try:
            self.line.answer(line, timeout_s)
        except BoardRestarted:
            self._recover()
            self.bearings.require_known()
        except DeviceRefused:
            self.bearings.way = None
            raise
        else:
            self.bearings.arrive(goal)

    def count_anew(self) -> None:
        """The place where the table stands is 0 for the board."""
        self.command("G50")
        self.bearings.count_anew()

    def hold(self, is_holding: bool) -> None:
        """Motor on or off."""
        self.command("M17" if is_holding else "M18")
        self.is_holding = is_holding

    def switch(self, channel: int, is_on: bool) -> None:
        """Put a laser on or off; out, where the board does not answer."""
        with dark_unless_answered(self.line.link, b"M70T%d\n" % channel):
            self.command(f"M7{int(is_on)}T{channel}")
        if is_on:
            self.lit_since_s.setdefault(channel, time.monotonic())
        else:
            self.lit_since_s.pop(channel, None)

    def rearm(self) -> None:
        """Start the firmware's timers anew; only M70 does that."""
        for channel in tuple(self.lit_since_s):
            self.line.request(f"M70T{channel}")
            self.line.request(f"M71T{channel}")
            self.lit_since_s[channel] = time.monotonic()

    def put_out(self) -> None:
        """All lasers that the board has."""
        for channel in self.kind.laser_channels:
            self.command(f"M70T{channel}")

    def _come_to_rest(self) -> None:
        if self.kind.is_clone:
            self.line.synchronise_clone(self.kind.seconds(self.kind.piece_deg, 0.0) + REPLY_S)
            if self.bearings.way is not None:
                # It has made the move or not; either way its count begins anew here.
                self.begin_anew()
                self.line.request("G50")
        else:
            at = self._standing_at()
            if self.bearings.way is None:
                # Counting was begun anew while the table stood.
                self.bearings.count_anew(at)
            self.bearings.arrive(at)
        self._restore()

    def _standing_at(self) -> float:
        """Bring the board to a standstill and out of its lock; where it counts itself."""
        status = self.line.halt(self.kind.brake_s)
        if status.state == "Alarm":
            self.line.request("$X")
        return self.kind.reached(status.x_deg)

    def _recover(self) -> None:
        """The board has started anew: its count is, lasers and motor are as they were asked for."""
        self.begin_anew()
        self.line.is_in_step = True
        if not self.kind.is_clone:
            # Another's reset byte leaves the count as it was.
            self.bearings.count_anew(self._standing_at())
        self._restore()

    def _restore(self) -> None:
        if self.is_holding:
            self.line.request("M17")
        self.rearm()
