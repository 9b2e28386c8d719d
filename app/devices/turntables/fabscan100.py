"""The first FabScan: single bytes out, hardly any back, and a laser that is on whenever the board starts."""

import contextlib
import re
import threading
import time
from collections import deque

from app.devices.overtaking import alone
from app.devices.serial_link import SerialLink
from app.devices.turntable import TURNTABLES, Farewell, SteadyTurn, TurntableFacts
from app.errors import (
    DeviceError,
    DeviceLost,
    DeviceRefused,
    DeviceTimeout,
    DeviceUnrecognised,
    MoveStopped,
    PositionUnknown,
)

_BAUD, _STOP_BITS = 9600, 2
_LASER_OFF, _LASER_ON, _STEP, _CLOCKWISE, _COUNTER_CLOCKWISE = b"\xc8", b"\xc9", b"\xca", b"\xcb", b"\xcc"
_MOTOR_ON, _MOTOR_OFF, _PING, _SELECT = b"\xcd", b"\xce", b"\xd2", b"\xd4"
_PONG = re.compile(rb"\xd3")
# The table's number in the shield's firmware, and in the first one, which does not answer when it is chosen.
_TABLE, _FIRST_TABLE = b"\x0a", b"\x00"
# Ends a command that was broken off before its second byte, and means nothing by itself.
_NOTHING = b"\x00"
_STEP_S = 0.006
_BOOT_S = 2.5
# Shorter than the boot loader, so that the 211 after a reset is not taken for the answer to a ping.
_PONG_S = 0.6
_REBOOT_S = 1.5
# The board makes one piece while the next waits in its buffer: the table does not pause, a stop takes 0.4 s.
_PIECE_STEPS, _PIECES_AHEAD = 32, 2
_GUARD_S = 0.25
_BEAT_S = 0.01
_CHANNEL = 1


class FabScan100:
    """Arduino with the binary firmware of francisengelmann/FabScan100 and one laser.

    It makes a step in 6 ms and answers a ping only, which waits behind the steps. After every start its laser
    is on and its motor off; the driver puts that right, also when the board has reset itself. The motor holds
    the table from the first move until it is told not to.

    Attributes:
        port: where the board is connected.
        name: what messages call it.
        steps_per_turn: of the table; 3200 for 200 steps a turn in sixteenths.
    """

    def __init__(self, port: str, name: str = "turntable", steps_per_turn: int = 3200) -> None:
        if steps_per_turn <= 0:
            raise DeviceRefused(name, "steps_per_turn must be positive")
        self.port, self.name, self.steps_per_turn = port, name, steps_per_turn
        self._link = SerialLink(port, _BAUD, name, stop_bits=_STOP_BITS)
        self._origin_deg = 0.0
        self._steps = 0
        self._pieces: deque[int] = deque()
        self._is_powered = self._is_lit = False
        self._stops = 0
        self._turning: threading.Thread | None = None
        self._turn_error: DeviceError | None = None
        self._is_over = threading.Event()
        self._guard: threading.Thread | None = None

    @property
    def facts(self) -> TurntableFacts:
        smallest = 360.0 / self.steps_per_turn
        return TurntableFacts(
            "FabScan100", self.port, (_CHANNEL,), smallest, fastest_deg_s=smallest / _STEP_S
        )

    @property
    def angle_deg(self) -> float:
        return self._degrees(self._steps)

    @property
    def farewell(self) -> Farewell | None:
        # Opening may reset the board, which then puts its laser on.
        words = ((b"", 1.6), (_NOTHING + _LASER_OFF + _MOTOR_OFF, 0.2))
        return Farewell(self.port, _BAUD, words, _STOP_BITS)

    @property
    def is_connected(self) -> bool:
        return self._link.is_open

    def connect(self) -> None:
        is_new = not self._link.is_open
        if is_new:
            self._release_port()
            self._link.open()
        try:
            with self._link.dialogue():
                self._recognise(self._link.listen(_BOOT_S, _PONG) if is_new else b"")
                self._select_table()
                self._is_lit = False
                lost = self._lost_position() if self._pieces else None
                self._pieces.clear()
                self._restore()
        except DeviceError:
            self._release_port()
            raise
        if is_new:
            self._is_over.clear()
            self._guard = threading.Thread(target=self._watch, name=f"guard of {self.port}", daemon=True)
            self._guard.start()
        if lost is not None:
            raise lost

    def disconnect(self) -> None:
        if self._link.is_open:
            self.make_safe()
        self._release_port()

    def move_to(self, angle_deg: float) -> float:
        stops = self._stops
        self._check_free()
        with self._link.dialogue():
            target = round((angle_deg - self._origin_deg) / 360.0 * self.steps_per_turn)
            self._settle()
            if target != self._steps:
                self._set_out(target - self._steps)
                sent = self._steps
                while self._steps != target:
                    while sent != target and len(self._pieces) < _PIECES_AHEAD:
                        piece = max(-_PIECE_STEPS, min(_PIECE_STEPS, target - sent))
                        self._send(piece, stops)
                        sent += piece
                    self._await_piece()
        return self.angle_deg

    def start_turning(self, angle_deg: float, speed_deg_s: float) -> SteadyTurn:
        steps = round(angle_deg / 360.0 * self.steps_per_turn)
        rate = abs(speed_deg_s) / 360.0 * self.steps_per_turn
        if not 0.0 < rate <= 1.0 / _STEP_S:
            fastest = self.facts.fastest_deg_s
            raise DeviceRefused(
                self.name,
                f"cannot turn at {speed_deg_s:g} degrees per second",
                f"Choose a speed above 0 and up to {fastest:g}.",
            )
        self._check_free()
        with self._link.dialogue():
            self._settle()
            self._set_out(steps)
            start, self._turn_error = self._steps, None
        started_s = time.monotonic()
        self._turning = threading.Thread(
            target=self._pace,
            args=(steps, rate, started_s, self._stops),
            name=f"steps of {self.port}",
            daemon=True,
        )
        self._turning.start()
        speed = rate * 360.0 / self.steps_per_turn * (1 if steps >= 0 else -1)
        return SteadyTurn(
            self._degrees(start), self._degrees(start + steps), speed, started_s, 0.0, abs(steps) / rate
        )

    def finish_turning(self) -> float:
        if self._turning is not None:
            self._turning.join()
            self._turning = None
        error, self._turn_error = self._turn_error, None
        if error is not None:
            raise error
        return self.angle_deg

    def position_now(self) -> float | None:
        return None

    @alone
    def stop(self) -> float:
        self._stops += 1
        self._link.interrupt()
        with self._link.dialogue():
            self._settle()
        return self.angle_deg

    def zero(self, angle_deg: float = 0.0) -> None:
        self._origin_deg += angle_deg - self.angle_deg

    def set_laser(self, channel: int, is_on: bool) -> None:
        if channel != _CHANNEL:
            raise DeviceRefused(self.name, f"has no laser {channel}", f"Its only laser is {_CHANNEL}.")
        with self._link.dialogue(wait_s=120.0):
            self._command(_LASER_ON if is_on else _LASER_OFF)
            self._is_lit = is_on

    def hold(self, is_holding: bool) -> None:
        with self._link.dialogue(wait_s=120.0):
            self._command(_MOTOR_ON if is_holding else _MOTOR_OFF)
            self._is_powered = is_holding

    @alone
    def make_safe(self) -> None:
        self._stops += 1
        self._link.interrupt()
        with contextlib.suppress(DeviceError):
            # Waits in the board's buffer until the pieces under way are over.
            self._link.write(_LASER_OFF)
            self._is_lit = False
            with self._link.dialogue():
                self._command(_LASER_OFF + _MOTOR_OFF)
                self._is_powered = False

    def talk(self, line: str) -> str:
        """Numbers from 0 to 255, separated by spaces, as the firmware's table lists them."""
        try:
            data = bytes(int(word) for word in line.split())
        except ValueError as error:
            raise DeviceRefused(
                self.name, f"does not understand {line!r}", "Write byte values, such as 210."
            ) from error
        if b"\xd1" in data:
            raise DeviceRefused(self.name, "never comes back from 209", "Leave that command out.")
        with self._link.dialogue():
            self._settle()
            self._link.write(data)
            return " ".join(str(byte) for byte in self._link.listen(0.5))

    def _check_free(self) -> None:
        if self._turning is not None and self._turning.is_alive():
            raise DeviceRefused(self.name, "is in a steady turn", "Wait for its end, or stop it.")

    def _recognise(self, heard: bytes) -> None:
        """Make sure who it is, without sending anything to a board that has said something else.

        Raises:
            DeviceUnrecognised: it is not this board.
        """
        if heard and not _PONG.search(heard):
            raise DeviceUnrecognised(self.name, f"{self.port} is no FabScan100; it sends {heard[:20]!r}")
        if heard:
            self._link.write(_LASER_OFF)
        self._link.discard()
        for _ in range(2):
            self._link.write(_NOTHING + _PING)
            with contextlib.suppress(DeviceTimeout):
                self._link.wait_for(_PONG, 1.0, "ping")
                self._link.write(_LASER_OFF)
                return
        raise DeviceUnrecognised(self.name, f"{self.port} does not answer as a FabScan100")

    def _select_table(self) -> None:
        self._link.write(_SELECT + _TABLE)
        try:
            self._link.wait_for(re.compile(_TABLE), 0.3, "select the table")
        except DeviceTimeout:
            self._link.write(_SELECT + _FIRST_TABLE)

    def _restore(self) -> None:
        """Laser and motor as they were asked for."""
        laser = _LASER_ON if self._is_lit else _LASER_OFF
        self._link.write(laser + (_MOTOR_ON if self._is_powered else _MOTOR_OFF))

    def _set_out(self, steps: int) -> None:
        """Motor on, and the direction; positive is counter-clockwise."""
        self._is_powered = True
        self._link.write(_MOTOR_ON + (_COUNTER_CLOCKWISE if steps > 0 else _CLOCKWISE))

    def _send(self, piece: int, stops: int) -> None:
        """Have some steps made, and a ping answered behind them; unless somebody has said stop since."""
        if self._stops != stops:
            raise MoveStopped(self.name, "the move was stopped")
        self._pieces.append(piece)
        try:
            self._link.write(_STEP + bytes([abs(piece)]) + _PING)
        except DeviceLost:
            self._pieces.pop()
            raise

    def _await_piece(self) -> None:
        self._await_pong(abs(self._pieces[0]) * _STEP_S + _PONG_S)
        self._steps += self._pieces.popleft()

    def _settle(self) -> None:
        """Wait for the steps that were sent before a stop; then nothing is under way."""
        while self._pieces:
            self._await_piece()
        self._heed(self._link.discard())

    def _command(self, data: bytes) -> None:
        """Send something and wait until it is done; a board that has just reset itself is told once more."""
        self._settle()
        self._link.write(data + _PING)
        try:
            self._await_pong(_PONG_S)
        except PositionUnknown:
            self._link.write(data + _PING)
            self._await_pong(_PONG_S)

    def _await_pong(self, timeout_s: float) -> None:
        """Raises PositionUnknown when the board has reset itself instead of answering."""
        try:
            self._link.wait_for(_PONG, timeout_s, "ping")
        except DeviceTimeout:
            if not _PONG.search(self._link.listen(_REBOOT_S, _PONG)):
                raise
            lost = self._lost_position()
            self._pieces.clear()
            self._restore()
            raise lost from None

    def _heed(self, heard: bytes) -> None:
        """A 211 that nobody asked for: the board has reset itself, and its laser is on."""
        if _PONG.search(heard):
            self._restore()

    def _pace(self, steps: int, rate: float, started_s: float, stops: int) -> None:
        """Thread: let out single steps as their time comes."""
        way, total, sent = (1 if steps > 0 else -1), abs(steps), 0
        try:
            while sent < total or self._pieces:
                # Between two beats a laser may be switched.
                with self._link.dialogue():
                    piece = min(total, int((time.monotonic() - started_s) * rate)) - sent
                    if piece > 0:
                        piece = min(piece, _PIECE_STEPS)
                        self._send(way * piece, stops)
                        sent += piece
                    while self._pieces and (len(self._pieces) > _PIECES_AHEAD or sent == total):
                        self._await_piece()
                time.sleep(min(_BEAT_S, 1.0 / rate))
        except DeviceError as error:
            self._turn_error = error

    def _watch(self) -> None:
        """Thread: notice a reset while nobody talks to the board."""
        while not self._is_over.wait(_GUARD_S):
            with contextlib.suppress(DeviceError), self._link.dialogue(wait_s=0.0):
                if not self._pieces:
                    self._heed(self._link.discard())

    def _release_port(self) -> None:
        self._is_over.set()
        if self._guard is not None:
            self._guard.join(timeout=5.0)
            self._guard = None
        self._link.close()

    def _lost_position(self) -> PositionUnknown:
        ends = (self._steps, self._steps + sum(self._pieces))
        return PositionUnknown(self.name, *sorted(map(self._degrees, ends)))

    def _degrees(self, steps: int) -> float:
        return self._origin_deg + 360.0 * steps / self.steps_per_turn


TURNTABLES.register("fabscan100", FabScan100)
