"""The first FabScan: single bytes out, hardly any back, and a laser that is on whenever the board starts."""

import contextlib
import threading
import time
from collections import deque

from app.devices.bearings import Bearings
from app.devices.board_driver import BoardDriver
from app.devices.fabscan100_line import (
    BAUD,
    CLOCKWISE,
    COUNTER_CLOCKWISE,
    ENDLESS,
    LASER_OFF,
    LASER_ON,
    MOTOR_OFF,
    MOTOR_ON,
    NOTHING,
    PING,
    PONG_S,
    STEP,
    STOP_BITS,
    BoardRestarted,
    FabScan100Line,
)
from app.devices.idle_watch import IdleWatch
from app.devices.laser_care import LASER_ANSWER_S
from app.devices.overtaking import alone
from app.devices.refusals import check_laser, check_speed
from app.devices.serial_link import SerialLink
from app.devices.turntable import TURNTABLES, Farewell, SteadyTurn, TurntableFacts
from app.errors import DeviceError, DeviceLost, DeviceRefused, MoveStopped

_STEP_S = 0.006
# The board makes one piece while the next waits in its buffer: the table does not pause, a stop takes 0.4 s.
_PIECE_STEPS, _PIECES_AHEAD = 32, 2
_GUARD_S = 0.25
_BEAT_S = 0.01
_BUSY_WAIT_S = 120.0
_CHANNEL = 1


class FabScan100(BoardDriver):
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
        super().__init__(
            SerialLink(port, BAUD, name, stop_bits=STOP_BITS), Bearings(name, steps_per_turn / 360.0)
        )
        self._line = FabScan100Line(self._link)
        # Steps that were sent and are not confirmed yet.
        self._pieces: deque[int] = deque()
        self._stops = 0
        self._turning: threading.Thread | None = None
        self._turn_error: DeviceError | None = None
        self._guard = IdleWatch(self._link, f"guard of {port}", _GUARD_S, self._watch)

    @property
    def facts(self) -> TurntableFacts:
        smallest = 1.0 / self._bearings.per_deg
        return TurntableFacts(
            "FabScan100", self.port, (_CHANNEL,), smallest, fastest_deg_s=smallest / _STEP_S
        )

    @property
    def farewell(self) -> Farewell | None:
        # Again for a board that opening resets, which then puts its laser on.
        words = ((NOTHING + LASER_OFF, 1.6), (NOTHING + LASER_OFF + MOTOR_OFF, 0.2))
        return Farewell(self.port, BAUD, words, STOP_BITS)

    def connect(self) -> None:
        is_new = not self._link.is_open
        if is_new:
            self._release()
            self._link.open()
        try:
            with self._link.dialogue():
                self._line.greet(is_new=is_new)
                self._line.is_lit = False
                self._lose_pieces()
                self._line.restore()
        except DeviceError:
            self._release()
            raise
        self._guard.start()
        self._bearings.require_known()

    def move_to(self, angle_deg: float) -> float:
        stops = self._stops
        self._check_free()
        with self._link.dialogue():
            self._settle()
            self._bearings.require_known()
            target = self._bearings.nearest(angle_deg)
            sent = round(self._bearings.at)
            if target != sent:
                self._set_out(target - sent)
            while self._bearings.at != target:
                while sent != target and len(self._pieces) < _PIECES_AHEAD:
                    piece = max(-_PIECE_STEPS, min(_PIECE_STEPS, target - sent))
                    self._send(piece, stops)
                    sent += piece
                self._await_piece()
        return self.angle_deg

    def start_turning(self, angle_deg: float, speed_deg_s: float) -> SteadyTurn:
        check_speed(self.name, speed_deg_s, self.facts.slowest_deg_s, self.facts.fastest_deg_s)
        steps = round(angle_deg * self._bearings.per_deg)
        rate = min(abs(speed_deg_s) * self._bearings.per_deg, 1.0 / _STEP_S)
        self._check_free()
        with self._link.dialogue():
            self._settle()
            self._bearings.require_known()
            self._set_out(steps)
            start, self._turn_error = self._bearings.at, None
        started_s = time.monotonic()
        self._turning = threading.Thread(
            target=self._pace,
            args=(steps, rate, started_s, self._stops),
            name=f"steps of {self.port}",
            daemon=True,
        )
        self._turning.start()
        speed = rate / self._bearings.per_deg * (1 if steps >= 0 else -1)
        ends = (self._bearings.degrees(start), self._bearings.degrees(start + steps))
        return SteadyTurn(*ends, speed, started_s, 0.0, abs(steps) / rate)

    def finish_turning(self) -> float:
        if self._turning is not None:
            self._turning.join()
            self._turning = None
        error, self._turn_error = self._turn_error, None
        if error is not None:
            raise error
        return self.angle_deg

    @alone
    def stop(self) -> float:
        self._stops += 1
        self._link.interrupt()
        with self._link.dialogue():
            self._settle()
            self._bearings.require_known()
        return self.angle_deg

    def set_laser(self, channel: int, is_on: bool) -> None:
        check_laser(self.name, channel, (_CHANNEL,), f"Its only laser is {_CHANNEL}.")
        with self._link.dialogue(wait_s=_BUSY_WAIT_S):
            self._settle()
            self._line.command(LASER_ON if is_on else LASER_OFF, LASER_ANSWER_S, LASER_OFF)
            self._line.is_lit = is_on

    def hold(self, is_holding: bool) -> None:
        with self._link.dialogue(wait_s=_BUSY_WAIT_S):
            self._settle()
            self._line.command(MOTOR_ON if is_holding else MOTOR_OFF)
            self._line.is_powered = is_holding

    @alone
    def make_safe(self) -> None:
        self._stops += 1
        self._link.interrupt()
        with contextlib.suppress(DeviceError):
            # Waits in the board's buffer until the pieces under way are over.
            self._link.write(LASER_OFF)
            self._line.is_lit = False
            with self._link.dialogue():
                self._settle()
                self._line.command(LASER_OFF + MOTOR_OFF)
                self._line.is_powered = False

    def talk(self, line: str) -> str:
        """Numbers from 0 to 255, separated by spaces, as the firmware's table lists them."""
        try:
            data = bytes(int(word) for word in line.split())
        except ValueError as error:
            raise DeviceRefused(
                self.name, f"does not understand {line!r}", "Write byte values, such as 210."
            ) from error
        if ENDLESS in data:
            raise DeviceRefused(self.name, "never comes back from 209", "Leave that command out.")
        with self._link.dialogue():
            self._settle()
            self._link.write(data)
            return " ".join(str(byte) for byte in self._link.listen(0.5))

    def _check_free(self) -> None:
        if self._turning is not None and self._turning.is_alive():
            raise DeviceRefused(self.name, "is in a steady turn", "Wait for its end, or stop it.")

    def _set_out(self, steps: int) -> None:
        """Motor on, and the direction; positive is counter-clockwise."""
        self._line.is_powered = True
        self._link.write(MOTOR_ON + (COUNTER_CLOCKWISE if steps > 0 else CLOCKWISE))

    def _send(self, piece: int, stops: int) -> None:
        """Have some steps made, and a ping answered behind them; unless somebody has said stop since."""
        if self._stops != stops:
            raise MoveStopped(self.name, "the move was stopped")
        self._pieces.append(piece)
        try:
            self._link.write(STEP + bytes([abs(piece)]) + PING)
        except DeviceLost:
            self._pieces.pop()
            raise

    def _await_piece(self) -> None:
        """Raises PositionUnknown where the board has reset itself meanwhile."""
        try:
            self._line.await_pong(abs(self._pieces[0]) * _STEP_S + PONG_S)
        except BoardRestarted:
            self._lose_pieces()
            raise self._bearings.lost() from None
        self._bearings.arrive(self._bearings.at + self._pieces.popleft())

    def _lose_pieces(self) -> None:
        """Steps that were sent, and that nobody will hear of any more."""
        if self._pieces:
            self._bearings.set_out(self._bearings.at + sum(self._pieces))
            self._bearings.lose()
        self._pieces.clear()

    def _settle(self) -> None:
        """Wait for the steps that were sent before a stop; then nothing is under way."""
        while self._pieces:
            self._await_piece()
        self._line.heed()

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
        """Notice a reset while nobody talks to the board."""
        if not self._pieces:
            self._line.heed()

    def _release(self) -> None:
        self._guard.stop()
        super()._release()


TURNTABLES.register("fabscan100", FabScan100)
