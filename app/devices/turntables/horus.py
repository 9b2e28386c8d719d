"""BQ Ciclop and its kin: the Horus firmware 0.1 and 0.2, and the clone that knows whole degrees only."""

import contextlib
import math
import re
import time

from app.devices.bearings import Bearings
from app.devices.board_driver import BoardDriver
from app.devices.horus_board import HorusBoard, HorusTurn
from app.devices.horus_line import REPLY_S, BoardRestarted
from app.devices.horus_recognition import HorusRecognition
from app.devices.idle_watch import IdleWatch
from app.devices.overtaking import alone
from app.devices.refusals import check_laser, check_speed
from app.devices.serial_link import SerialLink
from app.devices.turntable import TURNTABLES, Farewell, SteadyTurn, TurntableFacts
from app.errors import DeviceError, DeviceRefused, MoveStopped, PositionUnknown

_SLACK = 1.3
_PATIENCE_S = 600.0
_SAFE_WAIT_S = 2.0
_TALK_S = 30.0
_TALK_END = re.compile(rb"(?:ok|error:[^\r\n]*|>)\r\n")
_LASER_LINE = re.compile(r"M7([01])T(\d)")
_SAME_DEG = 1e-6


class HorusTable(BoardDriver):
    """Ciclop with its ZUM board, an Uno with a CNC shield, or a Sardauscan with the Horus clone.

    Which of them it is is measured, as they give the same banner. The motor holds the table from the first
    move until it is told not to; lasers are re-armed before the firmware's timer (254 s) puts them out, which
    blinks for a millisecond.

    Attributes:
        port: where the board is connected.
        name: what messages call it.
        baud: 115200; 19200 with the Bluetooth build.
        speed_deg_s: of moves between stops; a clone has its own.
        acceleration_deg_s2: 0 for what the board has; another is written to its EEPROM once.
        resolution: `auto`, or `steps` for the true firmware and `degrees` for the clone.
        positions_per_turn: of a clone.
        laser_channels: T numbers of the lasers that are connected.
        rearm_s: a laser is switched anew when it has been on for so long.
    """

    def __init__(
        self,
        port: str,
        name: str = "turntable",
        baud: int = 115200,
        speed_deg_s: float = 60.0,
        acceleration_deg_s2: float = 0.0,
        resolution: str = "auto",
        positions_per_turn: int = 512,
        laser_channels: tuple[int, ...] = (1, 2),
        rearm_s: float = 240.0,
    ) -> None:
        if resolution not in ("auto", "steps", "degrees"):
            raise DeviceRefused(name, f"has no resolution {resolution!r}", "Use auto, steps or degrees.")
        if positions_per_turn <= 0 or rearm_s <= 0.0 or speed_deg_s <= 0.0 or acceleration_deg_s2 < 0.0:
            raise DeviceRefused(name, "its speed, acceleration, positions and times must be positive")
        super().__init__(SerialLink(port, baud, name), Bearings(name))
        self.baud, self._speed = baud, speed_deg_s
        self._channels, self._rearm_s = tuple(laser_channels), rearm_s
        self._board = HorusBoard(self._link, self._bearings)
        self._recognition = HorusRecognition(resolution, positions_per_turn, acceleration_deg_s2)
        self._keeper = IdleWatch(self._link, f"lasers of {port}", min(1.0, 0.02 * rearm_s), self._keep)
        self._stops = 0

    @property
    def facts(self) -> TurntableFacts:
        kind = self._board.kind
        return TurntableFacts(
            kind.firmware, self.port, tuple(n for n in self._channels if n in kind.laser_channels),
            kind.smallest_deg, kind.slowest_deg_s, kind.fastest_deg_s,
            can_turn_steadily=not kind.is_clone, tells_position=not kind.is_clone,
        )  # fmt: skip

    @property
    def farewell(self) -> Farewell | None:
        # A board that stands hears the lines at once. To one that moves nothing gets through but hold, stand,
        # reset; the lines after it are for the clone.
        off = self._board.words_off
        words = ((off, 0.0), (b"!", 1.2), (b"\x18", 0.8), (b"\n$X\n", 0.1), (off, 0.2), (b"M18\n", 0.1))
        return Farewell(self.port, self.baud, words)

    def connect(self) -> None:
        is_new = not self._link.is_open
        if is_new:
            self._release()
            self._link.open()
        try:
            with self._link.dialogue():
                if is_new:
                    self._recognise()
                self._board.meet()
        except DeviceError:
            self._release()
            raise
        self._keeper.start()
        self._bearings.require_known()

    def move_to(self, angle_deg: float) -> float:
        stops = self._stops
        with self._link.dialogue(wait_s=_PATIENCE_S):
            self._get_ready()
            while True:
                # Counting may have begun anew, which moves the places where the clone can stand.
                goal = self._place(angle_deg)
                if abs(goal - self._bearings.at) <= _SAME_DEG:
                    return self.angle_deg
                if self._stops != stops:
                    raise MoveStopped(self.name, "the move was stopped")
                self._prepare_way(goal)
                goal = self._place(angle_deg)
                left = goal - self._bearings.at
                way = math.copysign(min(abs(left), self._longest_deg()), left)
                self._go(goal if way == left else self._board.kind.reached(self._bearings.at + way))

    def start_turning(self, angle_deg: float, speed_deg_s: float) -> SteadyTurn:
        speed, board = abs(speed_deg_s), self._board
        if board.kind.is_clone:
            raise DeviceRefused(
                self.name, "turns at its own speed only", "Scan in steps, or flash the true Horus firmware."
            )
        self._check_speed(speed_deg_s)
        with self._link.dialogue(wait_s=_PATIENCE_S):
            self._get_ready()
            start_deg = self.angle_deg
            turned = self._place(start_deg + angle_deg) - self._bearings.at
            seconds = board.kind.seconds(turned, speed)
            self._check_lasers_last(seconds, speed)
            board.rearm()
            is_off = turned == 0.0
            while not is_off:
                goal = board.kind.reached(self._bearings.at + turned)
                line = board.kind.line(goal, speed)
                is_off = board.set_out(line, goal)
                board.turn = HorusTurn(line, goal, time.monotonic() + _SLACK * seconds + REPLY_S)
            started_s = time.monotonic()
        ramp_s = min(0.5 * seconds, speed / board.kind.fastest_deg_s * board.kind.brake_s)
        return SteadyTurn(
            start_deg, start_deg + turned, math.copysign(speed, turned), started_s, ramp_s, seconds
        )

    def finish_turning(self) -> float:
        with self._link.dialogue(wait_s=_PATIENCE_S):
            self._board.settle()
            self._bearings.require_known()
        return self.angle_deg

    def position_now(self) -> float | None:
        if self._board.kind.is_clone:
            return None
        try:
            with self._link.dialogue(wait_s=0.02):
                status = self._board.line.status()
        except BoardRestarted:
            return None
        except DeviceError:
            status = self._board.line.overheard()
        return None if status is None else self._bearings.degrees(status.x_deg)

    @alone
    def stop(self) -> float:
        self._interrupt()
        with self._link.dialogue(wait_s=_PATIENCE_S):
            self._board.turn = None
            self._board.settle()
            self._bearings.require_known()
        return self.angle_deg

    def set_laser(self, channel: int, is_on: bool) -> None:
        check_laser(self.name, channel, self.facts.laser_channels)
        with self._link.dialogue(wait_s=_PATIENCE_S):
            self._board.settle()
            self._board.switch(channel, is_on)

    def hold(self, is_holding: bool) -> None:
        with self._link.dialogue(wait_s=_PATIENCE_S):
            self._board.settle()
            self._board.hold(is_holding)

    @alone
    def make_safe(self) -> None:
        if not self._link.is_open:
            return
        self._board.lit_since_s.clear()
        self._board.is_holding = False
        self._interrupt()
        try:
            with self._link.dialogue(wait_s=_SAFE_WAIT_S + self._board.kind.brake_s):
                self._board.turn = None
                # That is for whoever moves or connects next; now the lasers matter.
                with contextlib.suppress(PositionUnknown):
                    self._board.settle()
                self._board.put_out()
                self._board.hold(False)
        except DeviceError:
            # A board that has lost the thread still knows this byte, which ends everything, or its lines.
            with contextlib.suppress(DeviceError):
                self._link.write(b"\x18" + self._board.words_off)
            raise

    def talk(self, line: str) -> str:
        with self._link.dialogue(wait_s=_PATIENCE_S):
            self._board.settle()
            self._link.write(line.encode("ascii", "replace") + b"\n")
            said = self._link.listen(_TALK_S if len(line) > 1 else REPLY_S, _TALK_END)
            found = _LASER_LINE.search(line.replace(" ", "").upper())
            if found and found[1] == "1":
                self._board.lit_since_s.setdefault(int(found[2]), time.monotonic())
            if not self._board.kind.is_clone:
                self._board.line.is_in_step = False
                self._board.settle()
        return said.decode("ascii", "replace")

    def _recognise(self) -> None:
        board = self._board
        board.kind = self._recognition.recognise(board.line, board.kind.brake_s, board.begin_anew)
        if not board.kind.is_clone:
            self._check_speed(self._speed)

    def _check_speed(self, speed_deg_s: float) -> None:
        kind = self._board.kind
        check_speed(self.name, speed_deg_s, kind.slowest_deg_s, kind.fastest_deg_s)

    def _check_lasers_last(self, seconds: float, speed: float) -> None:
        """Nothing can be sent in a steady turn, lasers anew neither."""
        if self._board.lit_since_s and seconds > self._rearm_s:
            longest_deg = self._board.kind.longest_deg(self._rearm_s, speed)
            raise DeviceRefused(
                self.name,
                f"cannot keep a laser on in a turn of {seconds:.0f} s; its firmware puts it out",
                f"Turn faster, or by at most {longest_deg:.0f} degrees at a time.",
            )

    def _get_ready(self) -> None:
        """Nothing under way, the place known, the motor on."""
        self._board.settle()
        self._bearings.require_known()
        if not self._board.is_holding:
            self._board.hold(True)

    def _place(self, angle_deg: float) -> float:
        """Where the board can stand nearest to an angle, as it counts."""
        return self._board.kind.reached(angle_deg - self._bearings.origin_deg)

    def _prepare_way(self, goal: float) -> None:
        """Lasers fresh enough for the move, and its end within what the board can count."""
        kind = self._board.kind
        seconds = kind.seconds(goal - self._bearings.at, self._speed)
        if time.monotonic() - self._board.oldest_s + seconds > self._rearm_s:
            self._board.rearm()
        if abs(self._bearings.at) > kind.limit_deg - kind.piece_deg:
            self._board.count_anew()

    def _longest_deg(self) -> float:
        kind = self._board.kind
        if not self._board.lit_since_s:
            return kind.piece_deg
        return min(kind.piece_deg, kind.longest_deg(0.95 * self._rearm_s, self._speed))

    def _go(self, goal: float) -> None:
        """One move, to a place where the board can stand; none where the board has just started anew."""
        seconds = self._board.kind.seconds(goal - self._bearings.at, self._speed)
        line = self._board.kind.line(goal, self._speed)
        if self._board.set_out(line, goal):
            self._board.answer(line, goal, _SLACK * seconds + REPLY_S)

    def _interrupt(self) -> None:
        """The move under way, whoever waits for it, is over as soon as the board can."""
        self._stops += 1
        if not self._board.kind.is_clone:
            if self._bearings.way is not None:
                self._board.line.wish(b"!")
            self._link.interrupt()

    def _keep(self) -> None:
        """Re-arm lasers that stay on while nobody sends anything."""
        board = self._board
        is_due = time.monotonic() - board.oldest_s >= self._rearm_s and not board.kind.is_clone
        if is_due and board.turn is None and self._bearings.way is None:
            board.settle()
            board.rearm()

    def _release(self) -> None:
        self._link.close()
        self._keeper.stop()


TURNTABLES.register("horus", HorusTable)
