"""Printer boards with Marlin: the table on X or on the extruder, lasers on spare pins or fan outputs."""

import contextlib
import math
import re
import time
from collections.abc import Iterator

from app.devices.bearings import Bearings
from app.devices.board_driver import BoardDriver
from app.devices.marlin_board import FASTEST_DEG_S, MarlinBoard
from app.devices.marlin_dialogue import MarlinRestarted
from app.devices.marlin_words import LaserWords
from app.devices.overtaking import overtaking
from app.devices.ramp import ramped_s, ramped_turn
from app.devices.refusals import check_laser, check_speed
from app.devices.serial_link import SerialLink
from app.devices.turntable import TURNTABLES, Farewell, SteadyTurn, TurntableFacts
from app.errors import DeviceError, DeviceLost, DeviceRefused, OptionError, PositionUnknown

# Firmware refuses extrusions of more than 200 units.
_LONGEST_DEG = {"X": math.inf, "E": 180.0}
_QUEUE = 14
# The rest of a move is waited for with M400, behind which nothing gets through.
_LAST_S = 0.1
_BUSY_WAIT_S = 3600.0
_TALK_S = 60.0


class Marlin(BoardDriver):
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
        super().__init__(SerialLink(port, baud, name), Bearings(name, steps_per_deg))
        self.speed, self._slowest_steps = min(speed, FASTEST_DEG_S), slowest_steps
        self._board = MarlinBoard(
            self._link, self._bearings, axis, acceleration, LaserWords(laser), tuple(lasers)
        )
        # Where the move under way goes, steps, and when it will be over.
        self._goal, self._ends_s = 0, 0.0

    @property
    def facts(self) -> TurntableFacts:
        per_deg = self._bearings.per_deg
        return TurntableFacts(
            self._board.dialogue.firmware,
            self.port,
            self._board.channels,
            1.0 / per_deg,
            slowest_deg_s=self._slowest_steps / per_deg,
            fastest_deg_s=FASTEST_DEG_S,
        )

    @property
    def farewell(self) -> Farewell | None:
        # For a board that opening does not reset, and again for one that it does.
        off = self._board.words_off
        words = ((b"\n" + off, 1.5), (b"M410\n", 0.1), (off + b"M18\n", 0.3))
        return Farewell(self.port, self._link.baud, words)

    def connect(self) -> None:
        self._board.lit.clear()
        try:
            if not (self.is_connected and self._still_answers()):
                self._board.reopen()
            with self._link.dialogue():
                self._board.set_lasers()
        except PositionUnknown:
            raise
        except DeviceError:
            self._link.close()
            raise
        self._bearings.require_known()

    def move_to(self, angle_deg: float) -> float:
        with self._standing():
            self._bearings.require_known()
            self._go(self._bearings.reached(angle_deg), self.speed)
            self._arrive()
            return self.angle_deg

    def start_turning(self, angle_deg: float, speed_deg_s: float) -> SteadyTurn:
        check_speed(self.name, speed_deg_s, self.facts.slowest_deg_s, self.facts.fastest_deg_s)
        most_deg = _QUEUE * _LONGEST_DEG[self._board.axis]
        if abs(angle_deg) > most_deg:
            raise DeviceRefused(self.name, f"turns by {most_deg:.0f} degrees at most")
        with self._standing():
            self._bearings.require_known()
            from_deg, speed = self.angle_deg, abs(speed_deg_s)
            to_deg = self._bearings.reached(from_deg + angle_deg)
            started_s = self._go(to_deg, speed)
            return ramped_turn(from_deg, to_deg, speed, self._board.acceleration, started_s)

    def finish_turning(self) -> float:
        with self._standing():
            self._bearings.require_known()
            return self.angle_deg

    def stop(self) -> float:
        with overtaking(self._link):
            self._break_off()
            self._bearings.require_known()
            return self.angle_deg

    def set_laser(self, channel: int, is_on: bool) -> None:
        known = ", ".join(map(str, self._board.channels))
        hint = f"Its lasers are {known}; the option `lasers` in the bench file has their numbers."
        check_laser(self.name, channel, self._board.channels, hint)
        with self._link.dialogue(wait_s=_BUSY_WAIT_S):
            self._board.switch(channel, is_on)

    def hold(self, is_holding: bool) -> None:
        with self._standing():
            self._board.ask(f"{'M17' if is_holding else 'M18'} {self._board.axis}")

    def make_safe(self) -> None:
        with overtaking(self._link):
            self._board.lit.clear()
            try:
                with contextlib.suppress(PositionUnknown):
                    self._break_off()
                for line in self._board.words_off.decode().splitlines():
                    self._board.ask(line)
            except DeviceLost:
                raise
            except DeviceError:
                # It hears nothing or has halted itself; a reset puts everything out.
                self._board.reopen()
            self._board.ask("M18")

    def talk(self, line: str) -> str:
        words = line.strip()
        with self._standing():
            try:
                answer = self._board.dialogue.ask_once(words, _TALK_S)
                position = self._board.dialogue.find_position()
            except MarlinRestarted:
                self._board.recover()
                return "start"
            if re.match(r"(G92|G28|M92)\b", words):
                # It has another idea of where it stands; the table is taken to stand where it stood.
                self._board.set_up()
            else:
                self._bearings.arrive(self._board.steps_told(position))
            return "\n".join(answer)

    def _go(self, goal_deg: float, speed: float) -> float:
        """Queue the way to a place; the monotonic time at which the table set out for it."""
        begin_deg = self.angle_deg
        way_deg = goal_deg - begin_deg
        duration_s = ramped_s(way_deg, speed, self._board.acceleration)
        parts = max(1, math.ceil(abs(way_deg) / _LONGEST_DEG[self._board.axis]))
        for part in range(1, parts + 1):
            self._queue(begin_deg + way_deg * part / parts, goal_deg, speed)
        started_s = time.monotonic()
        self._ends_s = started_s + duration_s
        return started_s

    def _queue(self, end_deg: float, goal_deg: float, speed: float) -> None:
        """One part of the way to a goal."""
        try:
            answer = self._board.ask_anew(lambda: self._move_word(end_deg, speed))
        except (PositionUnknown, DeviceRefused):
            raise
        except DeviceError:
            # It may have heard it or not.
            self._note_move(goal_deg)
            raise
        if any("prevented" in text for text in answer):
            raise self._refused_extrusion(answer)
        self._note_move(goal_deg)

    def _note_move(self, goal_deg: float) -> None:
        self._goal = self._bearings.nearest(goal_deg)
        self._bearings.set_out(self._goal)
        self._ends_s = time.monotonic()

    def _move_word(self, end_deg: float, speed: float) -> str:
        units = self._bearings.nearest(end_deg) / self._bearings.per_deg
        return f"G1 {self._board.axis}{units:.5f} F{60.0 * speed:.3f}"

    def _refused_extrusion(self, answer: list[str]) -> DeviceRefused:
        """The firmware counts on as if it had gone the way, and has to be told that it has not."""
        self._bearings.way = None
        self._board.count_anew(self._board.ask)
        words = answer[0].removeprefix("echo:").strip()
        return DeviceRefused(
            self.name,
            f"does not turn the extruder's axis: {words}",
            'Put the table on another axis (axis = "X"), or build the firmware without that protection.',
        )

    def _arrive(self) -> None:
        """Wait until the table stands, and make sure that it stands where it was sent."""
        if self._bearings.way is None:
            return
        try:
            self._board.dialogue.wait(max(0.0, self._ends_s - time.monotonic() - _LAST_S))
        except MarlinRestarted:
            self._board.recover()
        self._board.ask("M400")
        self._board.find_position()
        wanted_deg = self._bearings.degrees(self._goal)
        if self._bearings.at != self._goal:
            raise DeviceError(
                self.name,
                f"stopped at {self.angle_deg:.2f} instead of {wanted_deg:.2f} degrees",
                "An end switch or a limit of the firmware holds it; look at M119 and M211.",
            )

    def _break_off(self) -> None:
        """Stop a move under way, and know where."""
        way = self._bearings.way
        if way is not None:
            self._board.ask("M410")
        self._board.find_position()
        if way is not None and self._board.axis == "E":
            self._bearings.way = way
            self._bearings.lose()

    @contextlib.contextmanager
    def _standing(self) -> Iterator[None]:
        """A dialogue with a board whose table stands."""
        with self._link.dialogue(wait_s=_BUSY_WAIT_S):
            if not self._link.is_open:
                raise DeviceLost(self.name, "is not connected")
            self._arrive()
            yield

    def _still_answers(self) -> bool:
        with self._link.dialogue(wait_s=_BUSY_WAIT_S):
            return self._board.still_answers()


TURNTABLES.register("marlin", Marlin)
