"""Printer boards with Marlin: the table on X or on the extruder, lasers on spare pins or fan outputs."""

import contextlib
import math
import re
import time
from collections.abc import Callable, Iterator

from app.devices.marlin_dialogue import MarlinDialogue, MarlinPosition, MarlinRestarted
from app.devices.marlin_words import LaserWords, setup_words, steps_per_unit
from app.devices.overtaking import overtaking
from app.devices.ramp import ramped_s
from app.devices.serial_link import SerialLink
from app.devices.turntable import TURNTABLES, Farewell, SteadyTurn, TurntableFacts
from app.errors import DeviceError, DeviceLost, DeviceRefused, OptionError, PositionUnknown

_FASTEST_DEG_S = 360.0
# Firmware refuses extrusions of more than 200 units.
_LONGEST_DEG = {"X": math.inf, "E": 180.0}
_QUEUE = 14
# The rest of a move is waited for with M400, behind which nothing gets through.
_LAST_S = 0.1
_BUSY_WAIT_S = 3600.0
_TALK_S = 60.0
_CLOSED_S = 0.1
_STARTS = 3


class Marlin:
    """A board with Marlin 1.1 or 2.0, or a relative such as FABtotum's.

    The table turns in degrees: the axis gets as many steps per unit as a degree has. Nothing is stored in the
    board. A reset of the board, told by its `start`, is noticed with the next command: settings and lasers
    are set again. A move is stopped by M410 at once; on E the firmware then believes that the way was gone
    to its end, so that the position is unknown.

    Attributes:
        port: where the board is connected.
        name: what messages call it.
        baud: bits per second; 250000 on many printers.
        axis: the table's, `X` or `E`.
        steps_per_deg: motor steps in a degree of the table.
        speed: of moves, degrees per second.
        acceleration: degrees per second squared.
        laser: the word that switches lasers: `M42` for pins, `M106` for fan outputs, `M700` for FABtotum.
        lasers: numbers of the pins or fans; these are the channels.
        slowest_steps: steps per second below which the board turns faster than it is told: 32 on 8-bit
            boards, 0 on others.
    """

    def __init__(
        self,
        port: str,
        name: str = "turntable",
        baud: int = 115200,
        axis: str = "X",
        steps_per_deg: float = 3200 / 360,
        speed: float = 60.0,
        acceleration: float = 200.0,
        laser: str = "M42",
        lasers: tuple[int, ...] = (11, 6),
        slowest_steps: float = 32.0,
    ) -> None:
        if axis not in _LONGEST_DEG:
            raise OptionError(f"A Marlin board has no axis {axis!r} for a table.", 'Choose "X" or "E".')
        numbers = (steps_per_deg, speed, acceleration)
        if not all(math.isfinite(number) and number > 0.0 for number in numbers) or not slowest_steps >= 0.0:
            raise OptionError(
                "A Marlin board needs positive steps_per_deg, speed and acceleration.",
                "For 200 steps a turn and 16 microsteps, steps_per_deg is 8.8889.",
            )
        if not all(isinstance(channel, int) and channel >= 0 for channel in lasers):
            raise OptionError(
                "The lasers of a Marlin board are numbers of pins or fans.", "Write them as lasers = [11, 6]."
            )
        self.port, self.name = port, name
        self.axis, self.steps_per_deg = axis, steps_per_deg
        self.speed, self.acceleration = min(speed, _FASTEST_DEG_S), acceleration
        self._words, self._slowest_steps = LaserWords(laser), slowest_steps
        self._link = SerialLink(port, baud, name)
        self._board = MarlinDialogue(self._link)
        self._channels = tuple(lasers)
        self._lit: frozenset[int] = frozenset()
        self._steps = self._board_zero = 0
        self._origin_deg = 0.0
        self._underway: tuple[int, int] | None = None
        self._ends_s: float | None = None

    @property
    def facts(self) -> TurntableFacts:
        return TurntableFacts(
            self._board.firmware,
            self.port,
            self._channels,
            1.0 / self.steps_per_deg,
            slowest_deg_s=self._slowest_steps / self.steps_per_deg,
            fastest_deg_s=_FASTEST_DEG_S,
        )

    @property
    def angle_deg(self) -> float:
        return self._degrees(self._steps)

    @property
    def farewell(self) -> Farewell | None:
        # Opening resets the board, or it does not; both are waited for.
        off = "".join(f"{self._words.switch(channel, False)}\n" for channel in self._channels)
        return Farewell(
            self.port, self._link.baud, ((b"\n", 1.5), (b"M410\n", 0.1), (f"{off}M18\n".encode(), 0.3))
        )

    @property
    def is_connected(self) -> bool:
        return self._link.is_open

    def connect(self) -> None:
        self._lit = frozenset()
        try:
            if not (self.is_connected and self._still_answers()):
                self._reopen()
            with self._link.dialogue():
                self._set_lasers()
        except PositionUnknown:
            raise
        except DeviceError:
            self._link.close()
            raise
        self._require_known()

    def disconnect(self) -> None:
        if self.is_connected:
            with contextlib.suppress(DeviceError):
                self.make_safe()
        self._link.close()

    def move_to(self, angle_deg: float) -> float:
        with self._standing():
            self._require_known()
            self._go(self._steps_at(angle_deg), self.speed)
            self._arrive()
            return self.angle_deg

    def start_turning(self, angle_deg: float, speed_deg_s: float) -> SteadyTurn:
        facts = self.facts
        if not max(facts.slowest_deg_s, 1e-6) <= abs(speed_deg_s) <= facts.fastest_deg_s:
            low, high = facts.slowest_deg_s, facts.fastest_deg_s
            raise DeviceRefused(
                self.name,
                f"cannot turn at {speed_deg_s:g} degrees per second",
                f"Choose a speed from {low:.3g} to {high:.0f} degrees per second.",
            )
        if abs(angle_deg) > _QUEUE * _LONGEST_DEG[self.axis]:
            raise DeviceRefused(self.name, f"turns by {_QUEUE * _LONGEST_DEG[self.axis]:.0f} degrees at most")
        with self._standing():
            self._require_known()
            from_steps, speed = self._steps, abs(speed_deg_s)
            target = self._steps_at(self.angle_deg + angle_deg)
            duration_s = self._go(target, speed)
            started_s = (self._ends_s or time.monotonic()) - duration_s
            return SteadyTurn(
                self._degrees(from_steps),
                self._degrees(target),
                math.copysign(speed, target - from_steps),
                started_s,
                speed / self.acceleration,
                duration_s,
            )

    def finish_turning(self) -> float:
        with self._standing():
            self._require_known()
            return self.angle_deg

    def position_now(self) -> float | None:
        return None

    def stop(self) -> float:
        with overtaking(self._link):
            self._break_off()
            self._require_known()
            return self.angle_deg

    def zero(self, angle_deg: float = 0.0) -> None:
        self._origin_deg += angle_deg - self.angle_deg
        if self._ends_s is None:
            self._underway = None

    def set_laser(self, channel: int, is_on: bool) -> None:
        if channel not in self._channels:
            known = ", ".join(map(str, self._channels))
            raise DeviceRefused(
                self.name,
                f"has no laser {channel}",
                f"Its lasers are {known}; the option `lasers` in the bench file has their numbers.",
            )
        with self._link.dialogue(wait_s=_BUSY_WAIT_S):
            # Noted as lit from before the command, so that a reset in between lights it again.
            self._lit = self._lit | {channel} if is_on else self._lit - {channel}
            answer = self._ask(self._laser_word(channel))
            self._words.check(self.name, channel, answer)

    def hold(self, is_holding: bool) -> None:
        with self._standing():
            self._ask(f"{'M17' if is_holding else 'M18'} {self.axis}")

    def make_safe(self) -> None:
        with overtaking(self._link):
            self._lit = frozenset()
            try:
                with contextlib.suppress(PositionUnknown):
                    self._break_off()
                for channel in self._channels:
                    self._ask(self._laser_word(channel))
            except DeviceLost:
                raise
            except DeviceError:
                # It hears nothing or has halted itself; a reset puts everything out.
                self._reopen()
            self._ask("M18")

    def talk(self, line: str) -> str:
        words = line.strip()
        with self._standing():
            try:
                answer = self._board.ask_once(words, _TALK_S)
                position = self._board.find_position()
            except MarlinRestarted:
                self._recover()
                return "start"
            if re.match(r"(G92|G28|M92)\b", words):
                # It has another idea of where it stands; the table is taken to stand where it stood.
                self._set_up()
            else:
                self._steps = self._steps_told(position)
            return "\n".join(answer)

    def _go(self, target: int, speed: float) -> float:
        """Queue the way to a place; seconds until the table will stand there."""
        begin, way = self._steps, target - self._steps
        parts = max(1, math.ceil(abs(way) / (_LONGEST_DEG[self.axis] * self.steps_per_deg)))
        for part in range(1, parts + 1):
            end = begin + round(way * part / parts)
            try:
                answer = self._ask_with(lambda end=end: self._move_word(end, speed))  # type: ignore[misc]
            except (PositionUnknown, DeviceRefused):
                raise
            except DeviceError:
                # It may have heard it or not.
                self._underway, self._ends_s = (begin, target), time.monotonic()
                raise
            if any("prevented" in text for text in answer):
                raise self._refused_extrusion(answer)
            self._underway = (begin, target)
        duration_s = ramped_s(way / self.steps_per_deg, speed, self.acceleration)
        self._ends_s = time.monotonic() + duration_s
        return duration_s

    def _move_word(self, steps: int, speed: float) -> str:
        units = (steps - self._board_zero) / self.steps_per_deg
        return f"G1 {self.axis}{units:.5f} F{60.0 * speed:.3f}"

    def _refused_extrusion(self, answer: list[str]) -> DeviceRefused:
        """The firmware counts on as if it had gone the way, and has to be told that it has not."""
        self._underway = self._ends_s = None
        self._ask(f"G92 {self.axis}0")
        self._board_zero = self._steps
        words = answer[0].removeprefix("echo:").strip()
        return DeviceRefused(
            self.name,
            f"does not turn the extruder's axis: {words}",
            'Put the table on another axis (axis = "X"), or build the firmware without that protection.',
        )

    def _arrive(self) -> None:
        """Wait until the table stands, and make sure that it stands where it was sent."""
        if self._underway is None or self._ends_s is None:
            return
        target = self._underway[1]
        try:
            self._board.wait(max(0.0, self._ends_s - time.monotonic() - _LAST_S))
        except MarlinRestarted:
            self._recover()
        self._ask("M400")
        self._find_position()
        if self._steps != target:
            raise DeviceError(
                self.name,
                f"stopped at {self.angle_deg:.2f} instead of {self._degrees(target):.2f} degrees",
                "An end switch or a limit of the firmware holds it; look at M119 and M211.",
            )

    def _find_position(self) -> None:
        """Where the board says it is; a move that it has not lost is over then."""
        try:
            position = self._board.find_position()
        except MarlinRestarted:
            self._recover()
            position = self._board.find_position()
        self._steps = self._steps_told(position)
        if self._ends_s is not None:
            self._underway = self._ends_s = None

    def _break_off(self) -> None:
        """Stop a move under way, and know where."""
        underway = self._underway if self._ends_s is not None else None
        if underway is not None:
            self._ask("M410")
        self._find_position()
        if underway is not None and self.axis == "E":
            self._underway = underway

    @contextlib.contextmanager
    def _standing(self) -> Iterator[None]:
        """A dialogue with a board whose table stands."""
        with self._link.dialogue(wait_s=_BUSY_WAIT_S):
            if not self._link.is_open:
                raise DeviceLost(self.name, "is not connected")
            self._arrive()
            yield

    def _ask(self, line: str) -> list[str]:
        return self._ask_with(lambda: line)

    def _ask_with(self, line: Callable[[], str]) -> list[str]:
        """Ask, and once more a board that has reset itself meanwhile; positions in the line are new then.

        Raises:
            PositionUnknown: it did so in mid-move.
        """
        try:
            return self._board.ask(line())
        except MarlinRestarted:
            self._recover()
            return self._board.ask(line())

    def _still_answers(self) -> bool:
        with self._link.dialogue(wait_s=_BUSY_WAIT_S):
            try:
                self._find_position()
            except PositionUnknown:
                raise
            except DeviceError:
                return False
            return True

    def _reopen(self) -> None:
        """Open the port, which resets the board, unless it is one that does not reset."""
        if self._link.is_open:
            self._link.close()
            # So that there is an edge on DTR.
            time.sleep(_CLOSED_S)
        self._link.close()
        self._link.open()
        with self._link.dialogue():
            self._start_up()

    def _recover(self) -> None:
        """The board has reset itself; the angle is kept where the table stood."""
        self._start_up()
        self._require_known()

    def _start_up(self) -> None:
        self._ends_s = None
        for _ in range(_STARTS):
            try:
                self._board.greet()
                self._set_up()
                self._set_lasers()
            except MarlinRestarted:
                continue
            return
        raise DeviceLost(self.name, "resets itself again and again", "Check its power supply.")

    def _set_up(self) -> None:
        """Everything that a reset forgets."""
        words = setup_words(self.axis, self.acceleration, _FASTEST_DEG_S, self._words.laser)
        if steps_per_unit(self._board.ask("M503"), self.axis) != self.steps_per_deg:
            words += [f"M92 {self.axis}{self.steps_per_deg:.6f}"]
        for word in [*words, f"G92 {self.axis}0"]:
            self._board.ask(word)
        self._board_zero = self._steps

    def _set_lasers(self) -> None:
        for channel in self._channels:
            self._words.check(self.name, channel, self._board.ask(self._laser_word(channel)))

    def _laser_word(self, channel: int) -> str:
        return self._words.switch(channel, channel in self._lit)

    def _require_known(self) -> None:
        if self._underway is not None and self._ends_s is None:
            raise PositionUnknown(self.name, *sorted(map(self._degrees, self._underway)))

    def _steps_told(self, position: MarlinPosition) -> int:
        told = position.count if self.axis == "X" else round(position.extruder * self.steps_per_deg)
        return self._board_zero + told

    def _degrees(self, steps: int) -> float:
        return self._origin_deg + steps / self.steps_per_deg

    def _steps_at(self, angle_deg: float) -> int:
        return round((angle_deg - self._origin_deg) * self.steps_per_deg)


TURNTABLES.register("marlin", Marlin)
