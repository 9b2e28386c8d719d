"""The Sardauscan with its own firmware: words ended by CR, one line back when the deed is done."""

import contextlib
import math
import re

from app.devices.bearings import Bearings
from app.devices.board_driver import BoardDriver
from app.devices.laser_care import LASER_ANSWER_S, dark_unless_answered
from app.devices.overtaking import alone
from app.devices.refusals import check_laser, resets_again
from app.devices.serial_link import SerialLink
from app.devices.turntable import TURNTABLES, Farewell, SteadyTurn, TurntableFacts
from app.errors import (
    DeviceError,
    DeviceRefused,
    DeviceTimeout,
    DeviceUnrecognised,
)

_BAUD = 115200
_BANNER_S = 2.5
_REPLY_S = 1.0
# The motor makes 500 half-steps/s after a ramp of 200 half-steps/s²; a unit is four half-steps.
_SPEED, _ACCELERATION, _HALF_STEPS = 500.0, 200.0, 4
# Nothing can be told to the board during a move, so that a stop, and a laser that shall go out, wait for the
# end of a piece: 2 s in the dark, 1 s with a laser on.
_PIECE_UNITS, _LIT_PIECE_UNITS = 50, 12
# The board multiplies by four in 16 bits.
_FARTHEST_UNITS = 8000
_UNITS_PER_TURN = 1018
# For what waits behind a piece.
_PATIENCE_S = 3.0
_BANNER = re.compile(rb"Sardauscan V(\S*)\r?\n")


class Sardauscan(BoardDriver):
    """Arduino with a geared 28BYJ-48 and up to four lasers; firmware of Sardau/Sardauscan.

    The motor turns at one speed and keeps its current after the first move; the firmware cannot let it go.

    Attributes:
        port: where the board is connected.
        name: what messages call it.
    """

    def __init__(self, port: str, name: str = "turntable") -> None:
        super().__init__(SerialLink(port, _BAUD, name), Bearings(name, _UNITS_PER_TURN / 360.0))
        self._facts = TurntableFacts("Sardauscan", port, (), 360.0 / _UNITS_PER_TURN)
        self._lit: set[int] = set()
        self._resets = 0
        self._is_in_step = True

    @property
    def facts(self) -> TurntableFacts:
        return self._facts

    @property
    def farewell(self) -> Farewell | None:
        # For a board that opening does not reset, and again for one that it does.
        lasers = b"".join(b"L %d 0\r" % channel for channel in self._facts.laser_channels)
        return Farewell(self.port, _BAUD, ((b"\r" + lasers, 1.5), (lasers, 0.2)))

    def connect(self) -> None:
        is_new = not self._link.is_open
        if is_new:
            self._link.close()
            self._link.open()
        with self._link.dialogue():
            heard = self._link.listen(_BANNER_S, _BANNER) if is_new else self._link.discard()
            # Nothing that is asked now may raise PositionUnknown before all is in order.
            way, self._bearings.way = self._bearings.way, None
            resets, self._is_in_step = self._resets, True
            try:
                self._shake_hands(heard)
                position = self._ask_position()
                was_reset = _BANNER.search(heard) is not None or self._resets != resets
                # A banner may have been missed, so that 0 says nothing after a move.
                self._place(position, way, is_anew=was_reset or (way is not None and position == 0))
                self._darken()
            except DeviceError:
                self._bearings.way = way
                self._link.close()
                raise
        self._bearings.require_known()

    def move_to(self, angle_deg: float) -> float:
        with self._link.dialogue():
            if self._bearings.way is not None:
                self._read_position()
            self._bearings.require_known()
            left = self._units_to(angle_deg)
            while left:
                longest = _LIT_PIECE_UNITS if self._lit else _PIECE_UNITS
                self._turn(max(-longest, min(longest, left)))
                left = self._units_to(angle_deg)
        return self.angle_deg

    def start_turning(self, angle_deg: float, speed_deg_s: float) -> SteadyTurn:
        raise DeviceRefused(
            self.name,
            "the Sardauscan firmware stops after every command and has only one speed",
            "Scan step by step with this board.",
        )

    def finish_turning(self) -> float:
        return self.angle_deg

    @alone
    def stop(self) -> float:
        self._link.interrupt()
        with self._link.dialogue():
            self._read_position()
            self._bearings.require_known()
        return self.angle_deg

    def set_laser(self, channel: int, is_on: bool) -> None:
        check_laser(self.name, channel, self._facts.laser_channels)
        with self._link.dialogue(wait_s=120.0):
            # Counted as lit from before the command, so that no move takes it for dark.
            self._lit.add(channel)
            with dark_unless_answered(self._link, b"L %d 0\r" % channel):
                self._switch(channel, is_on)
            if not is_on:
                self._lit.discard(channel)

    def hold(self, is_holding: bool) -> None:
        """The firmware has no word for it; the motor holds after its first move."""

    @alone
    def make_safe(self) -> None:
        self._link.interrupt()
        with contextlib.suppress(DeviceError):
            # Waits in the board's buffer until a piece under way is over.
            self._link.write(b"".join(b"L %d 0\r" % channel for channel in self._facts.laser_channels))
            with self._link.dialogue():
                self._read_position()
                self._darken()

    def _switch(self, channel: int, is_on: bool) -> None:
        command, answer = b"L %d %d" % (channel, is_on), rb"SET_LASER: %d\(-?\d+\) = (\d)\r?\n" % channel
        if int(self._request(command, answer, LASER_ANSWER_S)[1]) != is_on:
            raise DeviceError(self.name, f"did not switch laser {channel}")

    def talk(self, line: str) -> str:
        with self._link.dialogue():
            self._link.discard()
            self._link.write(line.encode("ascii", "replace") + b"\r")
            heard = self._link.read_line(piece_s(10 * _PIECE_UNITS) + _REPLY_S, line)
            self._read_position()
            return heard

    def _shake_hands(self, heard: bytes) -> None:
        """Make sure who it is, and learn what it has.

        Raises:
            DeviceUnrecognised: it is another board, or none.
        """
        try:
            # The first CR ends what an earlier program left in the board's buffer.
            self._request(b"\rsardauscan", rb"yes\r?\n", _PATIENCE_S)
        except DeviceTimeout as error:
            said = heard.decode("ascii", "replace").strip().splitlines()
            problem = f"is no Sardauscan; it says {said[0]!r}" if said else "does not answer as a Sardauscan"
            raise DeviceUnrecognised(self.name, f"{self.port} {problem}") from error
        version = _BANNER.search(heard)
        told = self._request(b"T S", rb"REVOLUTION STEPS\s+=> (\d+)\r?\n")
        units_per_turn = int(told[1])
        self._bearings.count_anew(self._bearings.at, units_per_turn / 360.0)
        count = int(self._request(b"L", rb"LASER_COUNT: (\d+)\r?\n")[1])
        fastest = _SPEED / _HALF_STEPS * 360.0 / units_per_turn
        self._facts = TurntableFacts(
            f"Sardauscan {version[1].decode('ascii', 'replace') if version else ''}".strip(),
            self.port,
            tuple(range(count)),
            360.0 / units_per_turn,
            fastest_deg_s=fastest,
            can_turn_steadily=False,
        )

    def _place(self, position: int, way: tuple[float, float] | None, *, is_anew: bool) -> None:
        """Make of the board's count an angle; a count that cannot be is that of a board that began anew.

        Args:
            position: what the board says.
            way: of the piece that was under way.
            is_anew: the board has begun anew for certain, or may have.
        """
        self._bearings.way = way
        lowest, highest = sorted(map(self._bearings.nearest, way or (self.angle_deg, self.angle_deg)))
        if lowest <= position <= highest and not is_anew:
            self._bearings.arrive(position)
        else:
            self._bearings.count_anew(position)
            self._bearings.lose()

    def _units_to(self, angle_deg: float) -> int:
        return round(self._bearings.nearest(angle_deg) - self._bearings.at)

    def _turn(self, units: int) -> None:
        """One piece of a move."""
        if abs(self._bearings.at + units) > _FARTHEST_UNITS:
            self._request(b"T C", rb"RESET CUTTENT POSITION[^\r\n]*\r?\n")
            self._bearings.count_anew()
        self._heed(self._link.discard())
        target = round(self._bearings.at) + units
        pattern = re.compile(rb"ABSOLUTE ROTATION -?\d+ => (?P<at>-?\d+)\r?\n|" + _BANNER.pattern)
        self._link.write(b"T A %d\r" % target)
        self._bearings.set_out(target)
        reply = self._link.wait_for(pattern, piece_s(abs(units)) + _REPLY_S, f"T A {target}")
        if reply["at"] is None:
            self._heed(reply[0])
        self._bearings.arrive(int(reply["at"]))

    def _read_position(self) -> None:
        self._place(self._ask_position(), self._bearings.way, is_anew=False)

    def _ask_position(self) -> int:
        return int(self._request(b"T", rb"Position (-?\d+)\r?\n", _PATIENCE_S)[1])

    def _darken(self) -> None:
        for channel in self._facts.laser_channels:
            self._request(b"L %d 0" % channel, rb"SET_LASER: %d\([^\r\n]*\r?\n" % channel)
        self._lit.clear()

    def _request(self, command: bytes, pattern: bytes, timeout_s: float = _REPLY_S) -> re.Match[bytes]:
        """Say something until it is answered; a board that has just reset itself is told once more."""
        if not self._is_in_step and command != b"T":
            # The answer to this is like no other.
            self._ask_position()
        either = re.compile(pattern + b"|(?P<banner>" + _BANNER.pattern + b")")
        for _ in range(2):
            self._heed(self._link.discard())
            self._is_in_step = False
            self._link.write(command + b"\r")
            reply = self._link.wait_for(either, timeout_s, command.decode())
            self._is_in_step = True
            if reply["banner"] is None:
                return reply
            self._heed(reply[0])
        raise resets_again(self.name)

    def _heed(self, heard: bytes) -> None:
        """A banner in mid-dialogue: the board has reset itself, its count is 0 and its lasers are off.

        Raises:
            PositionUnknown: it turned meanwhile.
        """
        if not _BANNER.search(heard):
            return
        self._resets += 1
        self._lit.clear()
        was_moving = self._bearings.way is not None
        self._bearings.count_anew()
        if was_moving:
            raise self._bearings.lost()


def piece_s(units: int) -> float:
    """How long a move takes, with its ramps."""
    half_steps = units * _HALF_STEPS
    if half_steps < _SPEED**2 / _ACCELERATION:
        return 2.0 * math.sqrt(half_steps / _ACCELERATION)
    return half_steps / _SPEED + _SPEED / _ACCELERATION


TURNTABLES.register("sardauscan", Sardauscan)
