"""Any board that takes a line and answers when it is done: everything is typed in."""

import contextlib
import math
import re
import time
from collections.abc import Callable, Sequence
from typing import TypeVar

from app.devices.command_template import (
    check_numbers,
    check_pairs,
    check_present,
    check_texts,
    parse_answer,
    parse_plain,
    parse_template,
    unescaped,
)
from app.devices.overtaking import alone
from app.devices.ramp import ramped_s
from app.devices.serial_link import SerialLink
from app.devices.turntable import TURNTABLES, Farewell, SteadyTurn, TurntableFacts
from app.errors import (
    DeviceError,
    DeviceLost,
    DeviceRefused,
    DeviceTimeout,
    DeviceUnrecognised,
    MoveStopped,
    OptionError,
    PositionUnknown,
)

_MOVE_WORDS = ("angle", "delta", "steps", "speed")
_LINE_ENDINGS = ("\n", "\r", "\r\n", ";", "")
_BUSY_WAIT_S = 120.0
_TRIES = 3

T = TypeVar("T")


class _Restarted(Exception):  # noqa: N818 (an event, not an error)
    """The board's banner came in mid-dialogue."""


class TemplateTable:
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
        self.port, self.name, self.baud = port, name, baud
        self._ending = unescaped("line_ending", line_ending)
        if self._ending not in _LINE_ENDINGS:
            raise OptionError(
                f"The template's field 'line_ending' cannot be {line_ending!r}.",
                r"Choose \n, \r, \r\n, ; or nothing.",
            )
        check_texts(
            {
                "banner": banner, "hello": hello, "hello_answer": hello_answer, "move": move, "done": done,
                "failed": failed, "laser_on": laser_on, "laser_off": laser_off, "laser_done": laser_done,
                "stop": stop, "stopped": stopped, "where": where, "where_answer": where_answer,
                "motor_on": motor_on, "motor_off": motor_off,
                **{f"init, line {number}": line for number, line in enumerate(init, 1)},
            }
        )  # fmt: skip
        check_present({"move": move, "done": done})
        check_pairs(
            {
                "hello hello_answer": (hello, hello_answer),
                "where where_answer": (where, where_answer),
                "laser_on laser_off": (laser_on, laser_off),
            }
        )
        check_numbers(
            {"speed_deg_s": speed_deg_s, "speed_factor": speed_factor, "boot_s": boot_s, "answer_s": answer_s}
        )
        check_numbers(
            {"steps_per_deg": steps_per_deg, "acceleration_deg_s2": acceleration_deg_s2}, or_zero=True
        )
        if not 0 <= decimals <= 9:
            raise OptionError("The template's field 'decimals' must be from 0 to 9.")
        self._move_text = parse_template("move", move, _MOVE_WORDS, ("angle", "delta", "steps"))
        if "steps" in self._move_text.names and steps_per_deg == 0.0:
            raise OptionError("The template's field 'move' has {steps}, so 'steps_per_deg' must be given.")
        self._channels = tuple(laser_channels) if laser_on else ()
        needed = ("channel",) if len(self._channels) > 1 else ()
        self._laser_texts = {
            True: parse_template("laser_on", laser_on, ("channel",), needed),
            False: parse_template("laser_off", laser_off, ("channel",), needed),
        }
        self._hello, self._where = parse_plain("hello", hello), parse_plain("where", where)
        self._stop, self._init = parse_plain("stop", stop), [parse_plain("init", line) for line in init]
        self._motor_texts = {
            True: parse_plain("motor_on", motor_on),
            False: parse_plain("motor_off", motor_off),
        }
        for field, text in (("done", done), ("laser_done", laser_done), ("stopped", stopped)):
            parse_answer(field, text)
        self._banner = parse_answer("banner", banner)
        self._failed = parse_answer("failed", failed)
        self._done, self._laser_done = done, laser_done or done
        self._stopped = stopped or done
        self._hello_answer = parse_answer("hello_answer", hello_answer)
        self._where_answer = parse_answer("where_answer", where_answer, groups=1)
        self._where_in_steps, self._is_relative = where_in_steps, relative
        self._quantum = 1.0 / steps_per_deg if steps_per_deg else 10.0**-decimals
        self._per_deg, self._speed, self._acceleration = steps_per_deg, speed_deg_s, acceleration_deg_s2
        self._speed_factor, self._decimals = speed_factor, decimals
        self._boot_s, self._answer_s = boot_s, answer_s
        self._link = SerialLink(port, baud, name)
        self._origin_deg, self._at = 0.0, 0
        self._underway: tuple[float, float] | None = None
        self._turn: SteadyTurn | None = None
        self._lit: set[int] = set()
        self._firmware = "typed in"
        self._is_known = self._is_in_step = False

    @property
    def facts(self) -> TurntableFacts:
        return TurntableFacts(
            self._firmware,
            self.port,
            self._channels,
            self._quantum,
            can_turn_steadily="speed" in self._move_text.names,
            can_stop=not (self._where.is_empty or self._stop.is_empty),
        )

    @property
    def angle_deg(self) -> float:
        return self._origin_deg + self._at * self._quantum

    @property
    def farewell(self) -> Farewell | None:
        texts = [self._stop.fill({})] if not self._stop.is_empty else []
        texts += self._dark_texts()
        texts += [self._motor_texts[False].fill({})] if not self._motor_texts[False].is_empty else []
        words = b"".join(self._line(text) for text in texts)
        # Once for a board that goes on as it was, once for one that opening has reset.
        return Farewell(self.port, self.baud, ((words, 1.5), (words, 0.3))) if words else None

    @property
    def is_connected(self) -> bool:
        return self._link.is_open

    def connect(self) -> None:
        if self._link.is_open:
            with self._link.dialogue(wait_s=_BUSY_WAIT_S):
                self._do(self._find_out)
            return
        self._link.close()
        self._link.open()
        self._turn, self._is_in_step = None, True
        try:
            with self._link.dialogue():
                self._link.listen(
                    self._boot_s, re.compile(self._banner.encode("latin-1")) if self._banner else None
                )
                self._do(self._begin)
        except PositionUnknown:
            raise
        except DeviceError:
            self._link.close()
            raise

    def disconnect(self) -> None:
        if self._link.is_open:
            with contextlib.suppress(DeviceError):
                self.make_safe()
        self._link.close()

    def move_to(self, angle_deg: float) -> float:
        with self._link.dialogue(wait_s=_BUSY_WAIT_S):
            self._do(lambda: self._move(angle_deg))
            return self.angle_deg

    def start_turning(self, angle_deg: float, speed_deg_s: float) -> SteadyTurn:
        if "speed" not in self._move_text.names or not speed_deg_s > 0.0:
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

    def position_now(self) -> float | None:
        return None

    @alone
    def stop(self) -> float:
        self._link.interrupt()
        if self._underway is not None and not self._stop.is_empty:
            self._link.write(self._line(self._stop.fill({})))
        with self._link.dialogue(wait_s=_BUSY_WAIT_S):
            if self._underway is not None:
                self._do(self._end_stopped)
            return self.angle_deg

    def zero(self, angle_deg: float = 0.0) -> None:
        self._origin_deg += angle_deg - self.angle_deg
        self._underway = None

    def set_laser(self, channel: int, is_on: bool) -> None:
        if channel not in self._channels:
            known = ", ".join(map(str, self._channels)) or "none"
            raise DeviceRefused(self.name, f"has no laser {channel}", f"Its lasers are: {known}.")
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
        if self._underway is not None:
            if self._stop.is_empty:
                # Heard in mid-move or not; what is answered to it is thrown away.
                self._link.write(b"".join(self._line(text) for text in self._dark_texts()))
                self._is_in_step = False
            with contextlib.suppress(PositionUnknown):
                self.stop()
        with self._link.dialogue(wait_s=_BUSY_WAIT_S):
            self._do(self._darken)
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
                    self._begin()
                return action()
            except _Restarted:
                has_restarted = True
        raise DeviceLost(self.name, "resets itself again and again", "Check its power supply.")

    def _move(self, angle_deg: float) -> None:
        self._ready()
        target = round((angle_deg - self._origin_deg) / self._quantum)
        if target != self._at:
            command = self._send_move(target, self._speed)
            self._await_move(command, target)

    def _start(self, angle_deg: float, speed_deg_s: float) -> SteadyTurn:
        self._ready()
        began = self.angle_deg
        target = round((began + angle_deg - self._origin_deg) / self._quantum)
        started_s = time.monotonic()
        turn = SteadyTurn(
            from_deg=began,
            to_deg=self._origin_deg + target * self._quantum,
            speed_deg_s=math.copysign(speed_deg_s, angle_deg),
            started_s=started_s,
            steady_after_s=speed_deg_s / self._acceleration if self._acceleration else 0.0,
            duration_s=self._duration_s(abs(target - self._at) * self._quantum, speed_deg_s),
        )
        if target != self._at:
            self._send_move(target, speed_deg_s)
            self._turn = turn
        return turn

    def _switch_when_ready(self, channel: int, is_on: bool) -> None:
        self._ready()
        self._switch(channel, is_on)

    def _give_current(self, is_holding: bool) -> None:
        text = self._motor_texts[is_holding]
        if not text.is_empty:
            self._ready()
            self._request(text.fill({}), self._done)

    def _say(self, line: str) -> str:
        self._ready()
        self._link.discard()
        self._link.write(self._line(line.encode("latin-1", "replace")))
        heard = self._link.listen(self._answer_s, self._pattern(self._done))
        if not self._where.is_empty:
            self._ask_position()
        return heard.decode("ascii", "replace").strip()

    def _dark_texts(self) -> list[bytes]:
        return [self._laser_texts[False].fill({"channel": channel}) for channel in self._channels]

    def _begin(self) -> None:
        """A board that has just started, or whose port was just opened."""
        if not self._hello.is_empty:
            try:
                said = self._request(self._hello.fill({}), self._hello_answer)
            except DeviceTimeout as error:
                raise DeviceUnrecognised(
                    self.name,
                    f"does not answer {self._hello.parts[0]!r} as the template says",
                    "Check `baud`, `line_ending` and `hello_answer`, or type to the board with a terminal.",
                ) from error
            self._firmware = said[0].decode("ascii", "replace").strip()
        for line in self._init:
            self._request(line.fill({}), self._done)
        lit, self._lit = self._lit, set()
        angle = self.angle_deg if self._is_known else 0.0
        self._at = 0
        if not self._where.is_empty:
            self._ask_position()
        self._origin_deg, self._is_known = angle - self._at * self._quantum, True
        if self._underway is not None:
            self._darken()
            raise self._lost_position()
        for channel in self._channels:
            self._switch(channel, channel in lit)

    def _ready(self) -> None:
        """Nothing under way, and every answer heard."""
        self._end_turn()
        if not self._is_in_step or self._underway is not None:
            self._find_out()

    def _find_out(self) -> None:
        """Get in step with a board that did not answer, and learn where it stands.

        Raises:
            PositionUnknown: it cannot tell.
        """
        self._turn = None
        if not self._hello.is_empty:
            self._request(self._hello.fill({}), self._hello_answer, self._most_s())
        elif not self._is_in_step:
            self._link.listen(self._answer_s)
        self._is_in_step = True
        if not self._where.is_empty:
            self._ask_position()
            self._underway = None
        elif self._underway is not None:
            raise self._lost_position()

    def _most_s(self) -> float:
        """What is under way may have to end before the board answers."""
        begins, ends = self._underway or (0.0, 0.0)
        return self._answer_s + 1.5 * self._duration_s(abs(ends - begins), self._speed)

    def _send_move(self, target: int, speed_deg_s: float) -> bytes:
        if not self._hello.is_empty:
            # A board that has reset itself unheard is found out before it can be taken for one in mid-move.
            self._request(self._hello.fill({}), self._hello_answer)
        goes = target - self._at
        steps = goes if self._is_relative else target
        command = self._move_text.fill(
            {
                "angle": target * self._quantum,
                "delta": goes * self._quantum,
                "steps": steps,
                "speed": speed_deg_s * self._speed_factor,
            },
            self._decimals,
        )
        self._heed(self._link.discard())
        self._link.write(self._line(command))
        self._underway = (self.angle_deg, self._origin_deg + target * self._quantum)
        return command

    def _await_move(self, command: bytes, target: int, speed_deg_s: float | None = None) -> None:
        way = abs(target - self._at) * self._quantum
        timeout_s = self._answer_s + 1.5 * self._duration_s(way, speed_deg_s or self._speed)
        try:
            self._await_answer(self._done, timeout_s, command)
        except DeviceRefused:
            self._underway = None
            raise
        self._at, self._underway = target, None

    def _end_turn(self) -> None:
        turn = self._turn
        if turn is not None:
            target = round((turn.to_deg - self._origin_deg) / self._quantum)
            self._await_move(b"the steady turn", target, abs(turn.speed_deg_s))
        self._turn = None

    def _end_stopped(self) -> None:
        """The move under way has been told to stop, or ends by itself.

        Raises:
            PositionUnknown: the board cannot tell where it stands.
        """
        pattern = self._done if self._stop.is_empty else f"{self._stopped}|{self._done}"
        self._turn = None
        with contextlib.suppress(DeviceTimeout, DeviceRefused):
            self._await_answer(pattern, self._most_s(), b"stop")
        if self._stop.is_empty:
            self._at = round(((self._underway or (0.0, 0.0))[1] - self._origin_deg) / self._quantum)
            self._underway = None
            return
        self._is_in_step = False
        self._find_out()

    def _duration_s(self, way_deg: float, speed_deg_s: float) -> float:
        return ramped_s(way_deg, speed_deg_s, self._acceleration or math.inf)

    def _switch(self, channel: int, is_on: bool) -> None:
        if is_on:
            # Counted as lit from before the command.
            self._lit.add(channel)
        self._request(self._laser_texts[is_on].fill({"channel": channel}), self._laser_done)
        if not is_on:
            self._lit.discard(channel)

    def _darken(self) -> None:
        for channel in self._channels:
            self._switch(channel, False)

    def _ask_position(self) -> None:
        # Up to the end of the line, lest half a number be taken for it.
        found = self._request(self._where.fill({}), f"(?:{self._where_answer})[^\r\n]*[\r\n]")
        try:
            value = float(found[1])
        except (ValueError, TypeError) as error:
            raise DeviceError(
                self.name, f"says where it stands with {found[0]!r}, which is no number"
            ) from error
        self._at = round(value if self._where_in_steps else value / self._quantum)

    def _request(self, command: bytes, answer: str, timeout_s: float | None = None) -> re.Match[bytes]:
        """Say something and wait for the answer."""
        self._heed(self._link.discard())
        self._link.write(self._line(command))
        return self._await_answer(answer, timeout_s or self._answer_s, command)

    def _heed(self, heard: bytes) -> None:
        """A banner that nobody asked for."""
        if self._banner and re.search(self._banner.encode("latin-1"), heard):
            self._turn, self._is_in_step = None, True
            raise _Restarted

    def _await_answer(self, answer: str, timeout_s: float, command: bytes) -> re.Match[bytes]:
        shown = command.decode("latin-1")
        is_in_step, self._is_in_step = self._is_in_step, False
        found = self._link.wait_for(self._pattern(answer), timeout_s, shown)
        self._is_in_step = is_in_step
        if found["banner"] is not None:
            self._turn = None
            raise _Restarted
        if found["failed"] is not None:
            said = found["failed"].decode("ascii", "replace")
            raise DeviceRefused(self.name, f"answered {said!r} to {shown!r}")
        return found

    def _pattern(self, answer: str) -> re.Pattern[bytes]:
        """Answer, complaint or banner; the answer first, so that its brackets keep their numbers."""
        never = "(?!)"
        failed = rf"(?P<failed>(?:{self._failed or never})[^\r\n]*)(?=[\r\n])"
        parts = f"(?:{answer})|{failed}|(?P<banner>{self._banner or never})"
        return re.compile(parts.encode("latin-1"))

    def _lost_position(self) -> PositionUnknown:
        ends, self._underway = self._underway or (self.angle_deg, self.angle_deg), None
        return PositionUnknown(self.name, *sorted(ends))

    def _line(self, command: bytes) -> bytes:
        return command + self._ending.encode()


TURNTABLES.register("template", TemplateTable)
