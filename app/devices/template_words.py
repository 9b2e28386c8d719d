"""What a person typed in for a board: checked field by field, and ready to be sent or listened for."""

import re
from collections.abc import Sequence

from app.devices.command_template import (
    CommandTemplate,
    check_pairs,
    check_present,
    check_texts,
    parse_answer,
    parse_plain,
    parse_template,
    unescaped,
)
from app.errors import OptionError

_MOVE_WORDS = ("angle", "delta", "steps", "speed")
_LINE_ENDINGS = ("\n", "\r", "\r\n", ";", "")
_NEVER = "(?!)"


class TemplateWords:
    """The options of a template that are text; `TemplateTable` says what each means.

    Attributes:
        move, hello, where, stop: commands; empty where there is none.
        init: commands for the start.
        laser: what switches a laser on (True) or off (False).
        motor: what gives the motor current, or lets it go.
        channels: numbers of the lasers.
        hello_answer, done, laser_done, stopped, where_answer: regular expressions for what is answered.

    Raises:
        OptionError: naming the field that cannot work.
    """

    def __init__(
        self,
        *,
        line_ending: str,
        banner: str,
        hello: str,
        hello_answer: str,
        init: Sequence[str],
        move: str,
        done: str,
        failed: str,
        laser_on: str,
        laser_off: str,
        laser_done: str,
        laser_channels: Sequence[int],
        stop: str,
        stopped: str,
        where: str,
        where_answer: str,
        motor_on: str,
        motor_off: str,
    ) -> None:
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
        self.move = parse_template("move", move, _MOVE_WORDS, ("angle", "delta", "steps"))
        self.channels = tuple(laser_channels) if laser_on else ()
        needed = ("channel",) if len(self.channels) > 1 else ()
        self.laser = {
            True: parse_template("laser_on", laser_on, ("channel",), needed),
            False: parse_template("laser_off", laser_off, ("channel",), needed),
        }
        self.motor = {True: parse_plain("motor_on", motor_on), False: parse_plain("motor_off", motor_off)}
        self.hello, self.where = parse_plain("hello", hello), parse_plain("where", where)
        self.stop, self.init = parse_plain("stop", stop), [parse_plain("init", line) for line in init]
        self.done = parse_answer("done", done)
        self.laser_done = parse_answer("laser_done", laser_done) or done
        self.stopped = parse_answer("stopped", stopped) or done
        self.hello_answer = parse_answer("hello_answer", hello_answer)
        self.where_answer = parse_answer("where_answer", where_answer, groups=1)
        self._banner, self._failed = parse_answer("banner", banner), parse_answer("failed", failed)

    def line(self, command: bytes) -> bytes:
        """With its ending."""
        return command + self._ending.encode()

    def lines(self, *texts: CommandTemplate) -> bytes:
        """Commands without numbers, one after the other; empty ones are left out."""
        return b"".join(self.line(text.fill({})) for text in texts if not text.is_empty)

    @property
    def lines_off(self) -> bytes:
        """What puts every laser out."""
        return b"".join(self.line_off(channel) for channel in self.channels)

    def line_off(self, channel: int) -> bytes:
        return self.line(self.laser[False].fill({"channel": channel}))

    @property
    def banner(self) -> re.Pattern[bytes] | None:
        """What the board says when it starts; None for nothing."""
        return re.compile(self._banner.encode("latin-1")) if self._banner else None

    def expected(self, answer: str) -> re.Pattern[bytes]:
        """Answer, complaint or banner; the answer first, so that its brackets keep their numbers."""
        failed = rf"(?P<failed>(?:{self._failed or _NEVER})[^\r\n]*)(?=[\r\n])"
        parts = f"(?:{answer})|{failed}|(?P<banner>{self._banner or _NEVER})"
        return re.compile(parts.encode("latin-1"))
