"""BQ Ciclop and its kin: the Horus firmware 0.1 and 0.2, and the clone that knows whole degrees only."""

import contextlib
import math
import re
import threading
import time

from app.devices.horus_kind import CloneHorus, HorusKind, TrueHorus, read_settings, true_horus
from app.devices.horus_line import BANNER, REPLY_S, BoardRestarted, HorusLine
from app.devices.overtaking import alone
from app.devices.serial_link import SerialLink
from app.devices.turntable import TURNTABLES, Farewell, SteadyTurn, TurntableFacts
from app.errors import (
    DeviceError,
    DeviceRefused,
    DeviceTimeout,
    DeviceUnrecognised,
    MoveStopped,
    PositionUnknown,
)

_BOOT_S = 2.5
_ASK_S = 0.25
_SLACK = 1.3
_PATIENCE_S = 600.0
_SAFE_WAIT_S = 2.0
_LISTING_S = 3.0
_TALK_S = 30.0
_TALK_END = re.compile(rb"(?:ok|error:[^\r\n]*|>)\r\n")
_CLONE_SAYS = re.compile(rb"(ok|error:[^\r\n]*)\r\n")
_LASER_LINE = re.compile(r"M7([01])T(\d)")
_SAME_DEG = 1e-6


class HorusTable:
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
        self.port, self.name, self.baud = port, name, baud
        self._speed, self._acceleration = speed_deg_s, acceleration_deg_s2
        self._resolution, self._positions = resolution, positions_per_turn
        self._channels, self._rearm_s = tuple(laser_channels), rearm_s
        self._link = SerialLink(port, baud, name)
        self._line = HorusLine(self._link)
        self._kind: HorusKind = TrueHorus()
        self._origin_deg = self._x_deg = 0.0
        self._travel: tuple[float, float] | None = None
        self._turn: tuple[str, float, float] | None = None
        self._unknown: PositionUnknown | None = None
        self._lit_since_s: dict[int, float] = {}
        self._is_holding = False
        self._stops = 0
        self._is_over = threading.Event()
        self._keeper: threading.Thread | None = None

    @property
    def facts(self) -> TurntableFacts:
        kind = self._kind
        return TurntableFacts(
            kind.firmware, self.port, tuple(n for n in self._channels if n in kind.laser_channels),
            kind.smallest_deg, kind.slowest_deg_s, kind.fastest_deg_s,
            can_turn_steadily=not kind.is_clone, tells_position=not kind.is_clone,
        )  # fmt: skip

    @property
    def angle_deg(self) -> float:
        return self._origin_deg + self._x_deg

    @property
    def farewell(self) -> Farewell | None:
        # Hold, stand, reset: nothing else gets through to a board that moves. The clone needs the lines.
        words = ((b"!", 1.2), (b"\x18", 0.8), (b"\n$X\n", 0.1), (self._words_off(), 0.2), (b"M18\n", 0.1))
        return Farewell(self.port, self.baud, words)

    @property
    def is_connected(self) -> bool:
        return self._link.is_open

    def connect(self) -> None:
        is_new = not self._link.is_open
        if is_new:
            self._release()
            self._link.open()
        try:
            with self._link.dialogue():
                if is_new:
                    self._recognise()
                self._meet()
        except PositionUnknown:
            self._start_keeper()
            raise
        except DeviceError:
            self._release()
            raise
        self._start_keeper()

    def disconnect(self) -> None:
        with contextlib.suppress(DeviceError):
            self.make_safe()
        self._release()

    def move_to(self, angle_deg: float) -> float:
        stops = self._stops
        with self._link.dialogue(wait_s=_PATIENCE_S):
            self._settle()
            self._hold_for_move()
            goal = self._kind.reached(angle_deg - self._origin_deg)
            while abs(goal - self._x_deg) > _SAME_DEG:
                if self._stops != stops:
                    raise MoveStopped(self.name, "the move was stopped")
                self._prepare_way(goal)
                # Counting may have begun anew, which moves the places where the clone can stand.
                goal = self._kind.reached(angle_deg - self._origin_deg)
                left = goal - self._x_deg
                way = math.copysign(min(abs(left), self._longest_deg()), left)
                self._go(goal if way == left else self._kind.reached(self._x_deg + way))
        return self.angle_deg

    def start_turning(self, angle_deg: float, speed_deg_s: float) -> SteadyTurn:
        speed = abs(speed_deg_s)
        self._refuse_speed(speed)
        with self._link.dialogue(wait_s=_PATIENCE_S):
            self._settle()
            self._hold_for_move()
            start_deg = self.angle_deg
            turned = self._kind.reached(self._x_deg + angle_deg) - self._x_deg
            seconds = self._kind.seconds(turned, speed)
            if self._lit_since_s and seconds > self._rearm_s:
                raise DeviceRefused(
                    self.name,
                    f"cannot keep a laser on in a turn of {seconds:.0f} s; its firmware puts it out",
                    f"Turn faster, or by at most {self._kind.longest_deg(self._rearm_s, speed):.0f} "
                    "degrees at a time.",
                )
            self._rearm()
            is_off = turned == 0.0
            while not is_off:
                goal = self._kind.reached(self._x_deg + turned)
                line = self._kind.line(goal, speed)
                is_off = self._set_out(line, goal)
                self._turn = (line, goal, time.monotonic() + _SLACK * seconds + REPLY_S)
            started_s = time.monotonic()
        ramp_s = min(0.5 * seconds, speed / self._kind.fastest_deg_s * self._kind.brake_s)
        return SteadyTurn(
            start_deg, start_deg + turned, math.copysign(speed, turned), started_s, ramp_s, seconds
        )

    def finish_turning(self) -> float:
        with self._link.dialogue(wait_s=_PATIENCE_S):
            self._settle()
        return self.angle_deg

    def position_now(self) -> float | None:
        if self._kind.is_clone:
            return None
        try:
            with self._link.dialogue(wait_s=0.02):
                status = self._line.status()
        except BoardRestarted:
            return None
        except DeviceError:
            status = self._line.overheard()
        return None if status is None else self._origin_deg + status.x_deg

    @alone
    def stop(self) -> float:
        self._interrupt()
        with self._link.dialogue(wait_s=_PATIENCE_S):
            self._turn = None
            self._settle()
        return self.angle_deg

    def zero(self, angle_deg: float = 0.0) -> None:
        with self._link.dialogue(wait_s=_PATIENCE_S):
            self._unknown = None
            self._origin_deg = angle_deg - self._x_deg

    def set_laser(self, channel: int, is_on: bool) -> None:
        if channel not in self.facts.laser_channels:
            known = ", ".join(map(str, self.facts.laser_channels))
            raise DeviceRefused(self.name, f"has no laser {channel}", f"Choose one of: {known}.")
        with self._link.dialogue(wait_s=_PATIENCE_S):
            self._settle()
            self._command(f"M7{int(is_on)}T{channel}")
            if is_on:
                self._lit_since_s.setdefault(channel, time.monotonic())
            else:
                self._lit_since_s.pop(channel, None)

    def hold(self, is_holding: bool) -> None:
        with self._link.dialogue(wait_s=_PATIENCE_S):
            self._settle()
            self._command("M17" if is_holding else "M18")
            self._is_holding = is_holding

    @alone
    def make_safe(self) -> None:
        if not self._link.is_open:
            return
        self._lit_since_s.clear()
        self._is_holding = False
        self._interrupt()
        try:
            with self._link.dialogue(wait_s=_SAFE_WAIT_S + self._kind.brake_s):
                self._turn = None
                try:
                    self._settle()
                except PositionUnknown as error:
                    # For whoever moves or connects next; now the lasers matter.
                    self._unknown = error
                self._put_out()
        except DeviceError:
            # A board that has lost the thread still knows this byte, which ends everything, or its lines.
            with contextlib.suppress(DeviceError):
                self._link.write(b"\x18" + self._words_off())
            raise

    def talk(self, line: str) -> str:
        with self._link.dialogue(wait_s=_PATIENCE_S):
            self._settle()
            self._link.write(line.encode("ascii", "replace") + b"\n")
            said = self._link.listen(_TALK_S if len(line) > 1 else REPLY_S, _TALK_END)
            found = _LASER_LINE.search(line.replace(" ", "").upper())
            if found and found[1] == "1":
                self._lit_since_s.setdefault(int(found[2]), time.monotonic())
            if not self._kind.is_clone:
                self._line.is_in_step = False
                self._settle()
        return said.decode("ascii", "replace")

    def _recognise(self) -> None:
        """Find out who is there: by the banner, and by what it makes of harmless questions.

        Raises:
            DeviceUnrecognised: no Horus.
        """
        heard = self._link.listen(_BOOT_S, re.compile(BANNER.pattern + rb"\r\n"))
        banner = BANNER.search(heard)
        if banner is None and b"Grbl" in heard:
            raise DeviceUnrecognised(
                self.name, f"{self.port} is a Grbl board", "Use the driver `grbl` for it."
            )
        self._line.is_in_step = True
        if banner:
            self._begin_anew()
        try:
            self._identify(banner[1].decode() if banner else "")
        except BoardRestarted:
            # Its boot loader took longer than others.
            self._begin_anew()
            self._identify("")

    def _begin_anew(self) -> None:
        """The board has been reset and counts from 0; the table stands where it stood."""
        self._line.has_told_feed = self._line.has_restarted = False
        if self._travel is not None:
            self._unknown = PositionUnknown(self.name, min(self._travel), max(self._travel))
        self._origin_deg, self._x_deg = self.angle_deg, 0.0
        self._travel = self._turn = None

    def _identify(self, version: str) -> None:
        if self._is_clone(has_banner=bool(version)):
            self._kind = CloneHorus(self._positions)
            return
        if not version:
            # It has not been reset, and may be in any state.
            self._line.halt(self._kind.brake_s)
            version = self._version()
        if (status := self._line.status()) is not None and status.state == "Alarm":
            self._line.request("$X")
        settings = dict(read_settings(self._line.request("$$", _LISTING_S)))
        wanted = self._acceleration
        if wanted and abs(settings.get(120, 0.0) - wanted) > 1e-3:
            self._line.request(f"$120={wanted:.3f}")
            settings[120] = wanted
        self._kind = true_horus(f"Horus {version}", settings)
        self._refuse_speed(self._speed)

    def _is_clone(self, *, has_banner: bool) -> bool:
        if self._resolution != "auto":
            return self._resolution == "degrees"
        if self._line.status(asks=2, wait_s=_ASK_S) is not None:
            return False
        if not has_banner:
            try:
                self._line.reset()
            except DeviceTimeout as error:
                raise DeviceUnrecognised(self.name, f"nothing on {self.port} answers as a Horus") from error
        # A line that the true firmware refuses, and the clone takes for a setting; before it, the end of
        # the line that its questions began.
        self._link.discard()
        self._link.write(b"\n$1\n")
        try:
            return self._link.wait_for(_CLONE_SAYS, REPLY_S, "$1")[1] == b"ok"
        except DeviceTimeout as error:
            raise DeviceUnrecognised(self.name, f"{self.port} has a Horus banner but no answers") from error

    def _version(self) -> str:
        said = re.search(r"\[(0\.[12]):", self._line.request("$I"))
        if said is None:
            raise DeviceUnrecognised(self.name, f"{self.port} is no Horus, but something like Grbl")
        return said[1]

    def _meet(self) -> None:
        """Where does the table stand, and lasers off."""
        self._lit_since_s.clear()
        self._turn = None
        self._line.is_in_step = False
        unknown: PositionUnknown | None = None
        try:
            self._settle()
        except PositionUnknown as error:
            unknown = error
        self._put_out(lets_go=False)
        if unknown is not None:
            raise unknown

    def _settle(self) -> None:
        """Nothing under way and no answer outstanding; a restart meanwhile noticed.

        Raises:
            PositionUnknown: the board was lost or has restarted in mid-move.
        """
        if self._turn is not None:
            self._finish()
        try:
            if BANNER.search(self._link.discard()) or self._line.has_restarted:
                raise BoardRestarted(self.name)
            if not self._line.is_in_step or self._travel is not None:
                self._come_to_rest()
        except BoardRestarted:
            self._recover()
        if self._unknown is not None:
            unknown, self._unknown = self._unknown, None
            raise unknown

    def _come_to_rest(self) -> None:
        if self._kind.is_clone:
            self._line.synchronise_clone(self._kind.seconds(self._kind.piece_deg, 0.0) + REPLY_S)
            if self._travel is not None:
                # It has made the move or not; either way its count begins anew here.
                self._begin_anew()
                self._line.request("G50")
        else:
            at = self._standing_at()
            if self._travel is None:
                # Counting was begun anew while the table stood.
                self._origin_deg = self.angle_deg - at
            self._x_deg = at
        self._travel = None
        self._restore()

    def _standing_at(self) -> float:
        """Bring the board to a standstill and out of its lock; where it counts itself."""
        status = self._line.halt(self._kind.brake_s)
        if status.state == "Alarm":
            self._line.request("$X")
        return self._kind.reached(status.x_deg)

    def _recover(self) -> None:
        """The board has started anew: its count is, lasers and motor are as they were asked for."""
        self._begin_anew()
        self._line.is_in_step = True
        if not self._kind.is_clone:
            # Another's reset byte leaves the count as it was.
            at = self._standing_at()
            self._origin_deg, self._x_deg = self.angle_deg - at, at
        self._restore()

    def _restore(self) -> None:
        if self._is_holding:
            self._line.request("M17")
        self._rearm()

    def _words_off(self) -> bytes:
        return b"".join(b"M70T%d\n" % channel for channel in self._kind.laser_channels)

    def _put_out(self, *, lets_go: bool = True) -> None:
        for channel in self._kind.laser_channels:
            self._command(f"M70T{channel}")
        if lets_go:
            self._command("M18")

    def _command(self, line: str) -> None:
        """One line while the table stands; once more where the board had just started anew."""
        try:
            self._line.request(line)
        except BoardRestarted:
            self._recover()
            self._line.request(line)

    def _hold_for_move(self) -> None:
        if not self._is_holding:
            self._command("M17")
            self._is_holding = True

    def _prepare_way(self, goal: float) -> None:
        """Lasers fresh enough for the move, and its end within what the board can count."""
        oldest_s = min(self._lit_since_s.values(), default=math.inf)
        seconds = self._kind.seconds(goal - self._x_deg, self._speed)
        if time.monotonic() - oldest_s + seconds > self._rearm_s:
            self._rearm()
        if abs(self._x_deg) > self._kind.limit_deg - self._kind.piece_deg:
            self._command("G50")
            self._origin_deg, self._x_deg = self.angle_deg, 0.0

    def _longest_deg(self) -> float:
        if not self._lit_since_s:
            return self._kind.piece_deg
        return min(self._kind.piece_deg, self._kind.longest_deg(0.95 * self._rearm_s, self._speed))

    def _go(self, goal: float) -> None:
        """One move, to a place where the board can stand; none where the board has just started anew."""
        seconds = self._kind.seconds(goal - self._x_deg, self._speed)
        line = self._kind.line(goal, self._speed)
        if self._set_out(line, goal):
            self._answer(line, goal, _SLACK * seconds + REPLY_S)

    def _set_out(self, line: str, goal: float) -> bool:
        """Begin a move. False where the board has started anew before: the place has another number now."""
        try:
            self._line.send(line)
        except BoardRestarted:
            self._recover()
            return False
        self._travel = (self.angle_deg, self._origin_deg + goal)
        return True

    def _answer(self, line: str, goal: float, timeout_s: float) -> None:
        try:
            self._line.answer(line, timeout_s)
        except BoardRestarted:
            self._recover()
            self._settle()
        except DeviceRefused:
            self._travel = None
            raise
        else:
            self._x_deg, self._travel = goal, None

    def _finish(self) -> None:
        """Wait for the end of the steady turn, if there is one."""
        if self._turn is not None and self._line.has_restarted:
            self._turn = None
        if self._turn is not None:
            (line, goal, ends_s), self._turn = self._turn, None
            self._answer(line, goal, max(REPLY_S, ends_s - time.monotonic()))

    def _interrupt(self) -> None:
        """The move under way, whoever waits for it, is over as soon as the board can."""
        self._stops += 1
        if not self._kind.is_clone:
            if self._travel is not None:
                self._line.wish(b"!")
            self._link.interrupt()

    def _refuse_speed(self, speed_deg_s: float) -> None:
        kind = self._kind
        if kind.is_clone:
            raise DeviceRefused(
                self.name, "turns at its own speed only", "Scan in steps, or flash the true Horus firmware."
            )
        if not kind.slowest_deg_s <= speed_deg_s <= kind.fastest_deg_s:
            raise DeviceRefused(
                self.name,
                f"cannot turn at {speed_deg_s:g} degrees per second",
                f"Choose a speed from {math.ceil(10 * kind.slowest_deg_s) / 10:g} to {kind.fastest_deg_s:g}.",
            )

    def _rearm(self) -> None:
        """Start the firmware's timers anew; only M70 does that."""
        for channel in tuple(self._lit_since_s):
            self._line.request(f"M70T{channel}")
            self._line.request(f"M71T{channel}")
            self._lit_since_s[channel] = time.monotonic()

    def _start_keeper(self) -> None:
        if self._keeper is None and self._link.is_open:
            self._is_over.clear()
            self._keeper = threading.Thread(target=self._keep, name=f"lasers of {self.port}", daemon=True)
            self._keeper.start()

    def _keep(self) -> None:
        """Re-arm lasers that stay on while nobody sends anything."""
        while not self._is_over.wait(min(1.0, 0.02 * self._rearm_s)):
            oldest_s = min(tuple(self._lit_since_s.values()), default=math.inf)
            if time.monotonic() - oldest_s < self._rearm_s or self._kind.is_clone:
                continue
            with contextlib.suppress(DeviceError), self._link.dialogue(wait_s=0.1):
                if self._turn is None and self._travel is None:
                    self._settle()
                    self._rearm()

    def _release(self) -> None:
        self._is_over.set()
        self._link.close()
        keeper, self._keeper = self._keeper, None
        if keeper is not None and keeper is not threading.current_thread():
            keeper.join(timeout=2.0)


TURNTABLES.register("horus", HorusTable)
