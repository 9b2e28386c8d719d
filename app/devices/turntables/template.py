"""Any board that takes a line and answers when it is done: everything is typed in."""

import contextlib
import math
import time
from collections.abc import Callable, Sequence
from typing import TypeVar

from app.devices.bearings import Bearings
from app.devices.board_driver import BoardDriver
from app.devices.command_template import check_numbers
from app.devices.overtaking import alone
from app.devices.ramp import ramped_s, ramped_turn
from app.devices.refusals import check_laser, resets_again
from app.devices.serial_link import SerialLink
from app.devices.template_board import TemplateBoard
from app.devices.template_dialogue import BoardRestarted, TemplateDialogue
from app.devices.template_words import TemplateWords
from app.devices.turntable import TURNTABLES, Farewell, SteadyTurn, TurntableFacts
from app.errors import (
    DeviceError,
    DeviceRefused,
    DeviceTimeout,
    MoveStopped,
    OptionError,
    PositionUnknown,
)

_BUSY_WAIT_S = 120.0
_TRIES = 3

T = TypeVar("T")


class TemplateTable(BoardDriver):
    r"""A board described by what one types to it and what it says.

    Commands may hold placeholders; answers are regular expressions. Positions count from where the table
    stood when the board started.

    Attributes:
        port: where the board is connected.
        name: what messages call it.
        baud: its rate.
        line_ending: behind every command: `\n`, `\r`, `\r\n`, `;` or nothing.
        banner: what the board says when it starts; empty where it says nothing.
        hello, hello_answer: a question that is safe to ask, and its answer.
        init: commands to send first, each answered by `done`.
        move: the command that turns the table: `{angle}` absolute degrees, `{delta}` degrees from where it
            stands, `{steps}` the same in steps, `{speed}`.
        relative: `{steps}` are counted from where it stands, not from zero.
        done: the answer to a command that has been done; for a move, when the table stands.
        failed: the answer to one that has not; empty where there is none.
        laser_on, laser_off: with `{channel}`; empty for a board without lasers.
        laser_done: where lasers are answered otherwise than by `done`; `()` where they are not answered.
        laser_channels: the numbers of the lasers.
        stop, stopped: what stops a move at once, and its answer.
        where, where_answer: asks for the position; the answer's brackets are around the number, and its line
            ends.
        where_in_steps: that number is steps, not degrees.
        motor_on, motor_off: gives the motor current, and lets it go.
        steps_per_deg: of the table; 0 for a board that turns by any angle.
        speed_deg_s: of moves; acceleration_deg_s2: of the board, 0 where unknown. Timeouts come from them.
        speed_factor: what a degree per second is in `{speed}`, such as 60 for degrees per minute.
        decimals: of numbers in commands.
        boot_s: how long the board needs after its port was opened.
        answer_s: how long it may take to answer, beyond the time of a move.
    """

    def __init__(
        self,
        port: str,
        name: str = "turntable",
        *,
        baud: int = 115200,
        line_ending: str = "\n",
        banner: str = "",
        hello: str = "",
        hello_answer: str = "",
        init: Sequence[str] = (),
        move: str = "",
        relative: bool = False,
        done: str = "",
        failed: str = "",
        laser_on: str = "",
        laser_off: str = "",
        laser_done: str = "",
        laser_channels: Sequence[int] = (1, 2),
        stop: str = "",
        stopped: str = "",
        where: str = "",
        where_answer: str = "",
        where_in_steps: bool = False,
        motor_on: str = "",
        motor_off: str = "",
        steps_per_deg: float = 0.0,
        speed_deg_s: float = 30.0,
        acceleration_deg_s2: float = 0.0,
        speed_factor: float = 1.0,
        decimals: int = 3,
        boot_s: float = 2.5,
        answer_s: float = 2.0,
    ) -> None:
        words = TemplateWords(
            line_ending=line_ending, banner=banner, hello=hello, hello_answer=hello_answer, init=init,
            move=move, done=done, failed=failed, laser_on=laser_on, laser_off=laser_off,
            laser_done=laser_done, laser_channels=laser_channels, stop=stop, stopped=stopped, where=where,
            where_answer=where_answer, motor_on=motor_on, motor_off=motor_off,
        )  # fmt: skip
        check_numbers(
            {"speed_deg_s": speed_deg_s, "speed_factor": speed_factor, "boot_s": boot_s, "answer_s": answer_s}
        )
        check_numbers(
            {"steps_per_deg": steps_per_deg, "acceleration_deg_s2": acceleration_deg_s2}, or_zero=True
        )
        if not 0 <= decimals <= 9:
            raise OptionError("The template's field 'decimals' must be from 0 to 9.")
        if "steps" in words.move.names and steps_per_deg == 0.0:
            raise OptionError("The template's field 'move' has {steps}, so 'steps_per_deg' must be given.")
        super().__init__(SerialLink(port, baud, name), Bearings(name, steps_per_deg or 10.0**decimals))
        self.baud, self._boot_s = baud, boot_s
        self._words, self._dialogue = words, TemplateDialogue(self._link, words, answer_s)
        self._board = TemplateBoard(self._dialogue, self._bearings, where_in_steps=where_in_steps)
        self._is_relative = relative
        self._speed, self._acceleration = speed_deg_s, acceleration_deg_s2 or math.inf
        self._speed_factor, self._decimals = speed_factor, decimals
        self._turn: SteadyTurn | None = None

    @property
    def facts(self) -> TurntableFacts:
        return TurntableFacts(
            self._dialogue.firmware,
            self.port,
            self._words.channels,
            1.0 / self._bearings.per_deg,
            can_turn_steadily="speed" in self._words.move.names,
            can_stop=not (self._words.where.is_empty or self._words.stop.is_empty),
        )

    @property
    def farewell(self) -> Farewell | None:
        words = self._words
        said = words.lines(words.stop) + words.lines_off + words.lines(words.motor[False])
        # Once for a board that goes on as it was, once for one that opening has reset.
        return Farewell(self.port, self.baud, ((said, 1.5), (said, 0.3))) if said else None

    def connect(self) -> None:
        if self._link.is_open:
            with self._link.dialogue(wait_s=_BUSY_WAIT_S):
                self._do(self._find_out)
                self._bearings.require_known()
            return
        self._link.close()
        self._link.open()
        self._turn, self._dialogue.is_in_step = None, True
        try:
            with self._link.dialogue():
                self._link.listen(self._boot_s, self._words.banner)
                self._do(self._board.begin)
                self._bearings.require_known()
        except PositionUnknown:
            raise
        except DeviceError:
            self._link.close()
            raise

    def move_to(self, angle_deg: float) -> float:
        with self._link.dialogue(wait_s=_BUSY_WAIT_S):
            self._do(lambda: self._move(angle_deg))
            return self.angle_deg

    def start_turning(self, angle_deg: float, speed_deg_s: float) -> SteadyTurn:
        if "speed" not in self._words.move.names or not speed_deg_s > 0.0:
            raise DeviceRefused(
                self.name,
                f"cannot turn at {speed_deg_s:g} degrees per second",
                "Put {speed} into the template's field 'move', or scan step by step.",
            )
        with self._link.dialogue(wait_s=_BUSY_WAIT_S):
            return self._do(lambda: self._start(angle_deg, speed_deg_s))

    def finish_turning(self) -> float:
        turn = self._turn
        with self._link.dialogue(wait_s=_BUSY_WAIT_S):
            if turn is not None and self._turn is not turn:
                raise MoveStopped(self.name, "the steady turn was stopped")
            self._do(self._end_turn)
            return self.angle_deg

    @alone
    def stop(self) -> float:
        self._link.interrupt()
        if self._bearings.way is not None:
            self._link.write(self._words.lines(self._words.stop))
        with self._link.dialogue(wait_s=_BUSY_WAIT_S):
            if self._bearings.way is not None:
                self._do(self._end_stopped)
            self._bearings.require_known()
            return self.angle_deg

    def zero(self, angle_deg: float = 0.0) -> None:
        super().zero(angle_deg)
        if self._turn is None:
            # A move that was given up waiting for; who knows the angle has looked.
            self._bearings.way = None

    def set_laser(self, channel: int, is_on: bool) -> None:
        check_laser(self.name, channel, self._words.channels)
        with self._link.dialogue(wait_s=_BUSY_WAIT_S):
            self._do(lambda: self._switch_when_ready(channel, is_on))

    def hold(self, is_holding: bool) -> None:
        with self._link.dialogue(wait_s=_BUSY_WAIT_S):
            self._do(lambda: self._give_current(is_holding))

    @alone
    def make_safe(self) -> None:
        if not self._link.is_open:
            return
        self._link.interrupt()
        if self._bearings.way is not None:
            if self._words.stop.is_empty:
                # Heard in mid-move or not; what is answered to it is thrown away.
                self._link.write(self._words.lines_off)
                self._dialogue.is_in_step = False
            with contextlib.suppress(PositionUnknown):
                self.stop()
        with self._link.dialogue(wait_s=_BUSY_WAIT_S):
            self._do(self._board.darken)
            self._do(lambda: self._give_current(False))

    def talk(self, line: str) -> str:
        with self._link.dialogue(wait_s=_BUSY_WAIT_S):
            return self._do(lambda: self._say(line.strip()))

    # What goes on inside a dialogue.

    def _do(self, action: Callable[[], T]) -> T:
        """Do something, again where the board has begun anew."""
        has_restarted = False
        for _ in range(_TRIES):
            try:
                if has_restarted:
                    self._board.begin()
                return action()
            except BoardRestarted:
                has_restarted, self._turn = True, None
        raise resets_again(self.name)

    def _find_out(self) -> None:
        self._turn = None
        self._board.find_out(self._most_s())

    def _ready(self) -> None:
        """Nothing under way, and every answer heard."""
        self._end_turn()
        if not self._dialogue.is_in_step or self._bearings.way is not None:
            self._find_out()

    def _move(self, angle_deg: float) -> None:
        self._ready()
        self._bearings.require_known()
        target = self._bearings.nearest(angle_deg)
        if target != self._bearings.at:
            command = self._send_move(target, self._speed)
            self._await_move(command, target, self._speed)

    def _start(self, angle_deg: float, speed_deg_s: float) -> SteadyTurn:
        self._ready()
        self._bearings.require_known()
        target = self._bearings.nearest(self.angle_deg + angle_deg)
        ends = (self.angle_deg, self._bearings.degrees(target))
        turn = ramped_turn(*ends, speed_deg_s, self._acceleration, time.monotonic())
        if target != self._bearings.at:
            self._send_move(target, speed_deg_s)
            self._turn = turn
        return turn

    def _send_move(self, target: int, speed_deg_s: float) -> bytes:
        # A board that has reset itself unheard is found out before it can be taken for one in mid-move.
        self._dialogue.knock()
        per_deg, goes = self._bearings.per_deg, target - self._bearings.at
        command = self._words.move.fill(
            {
                "angle": target / per_deg,
                "delta": goes / per_deg,
                "steps": goes if self._is_relative else target,
                "speed": speed_deg_s * self._speed_factor,
            },
            self._decimals,
        )
        self._dialogue.send(command)
        self._bearings.set_out(target)
        return command

    def _await_move(self, command: bytes, target: int, speed_deg_s: float) -> None:
        way_deg = (target - self._bearings.at) / self._bearings.per_deg
        timeout_s = self._longest_s(way_deg, speed_deg_s)
        try:
            self._dialogue.await_answer(self._words.done, timeout_s, command)
        except DeviceRefused:
            self._bearings.way = None
            raise
        self._bearings.arrive(target)

    def _end_turn(self) -> None:
        turn = self._turn
        if turn is not None:
            target = self._bearings.nearest(turn.to_deg)
            self._await_move(b"the steady turn", target, abs(turn.speed_deg_s))
        self._turn = None

    def _end_stopped(self) -> None:
        """The move under way has been told to stop, or ends by itself.

        Raises:
            PositionUnknown: the board cannot tell where it stands.
        """
        words = self._words
        pattern = words.done if words.stop.is_empty else f"{words.stopped}|{words.done}"
        self._turn = None
        with contextlib.suppress(DeviceTimeout, DeviceRefused):
            self._dialogue.await_answer(pattern, self._most_s(), b"stop")
        if words.stop.is_empty:
            way = self._bearings.way or (0.0, self.angle_deg)
            self._bearings.arrive(self._bearings.nearest(way[1]))
            return
        self._dialogue.is_in_step = False
        self._find_out()

    def _most_s(self) -> float:
        """What is under way may have to end before the board answers."""
        begins, ends = self._bearings.way or (0.0, 0.0)
        return self._longest_s(ends - begins, self._speed)

    def _longest_s(self, way_deg: float, speed_deg_s: float) -> float:
        return self._dialogue.answer_s + 1.5 * ramped_s(way_deg, speed_deg_s, self._acceleration)

    def _switch_when_ready(self, channel: int, is_on: bool) -> None:
        self._ready()
        self._board.switch(channel, is_on)

    def _give_current(self, is_holding: bool) -> None:
        if not self._words.motor[is_holding].is_empty:
            self._ready()
            self._board.give_current(is_holding)

    def _say(self, line: str) -> str:
        self._ready()
        self._link.discard()
        self._link.write(self._words.line(line.encode("latin-1", "replace")))
        heard = self._link.listen(self._dialogue.answer_s, self._words.expected(self._words.done))
        self._board.take_position()
        return heard.decode("ascii", "replace").strip()


TURNTABLES.register("template", TemplateTable)
