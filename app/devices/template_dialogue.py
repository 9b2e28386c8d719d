"""Request and answer with a board whose words were typed in."""

import re

from app.devices.serial_link import SerialLink
from app.devices.template_words import TemplateWords
from app.errors import DeviceError, DeviceRefused, DeviceTimeout, DeviceUnrecognised


class BoardRestarted(Exception):  # noqa: N818 (an event, not an error)
    """The board's banner came in mid-dialogue."""


class TemplateDialogue:
    """One line out, its answer back, over a link that its owner opens and closes.

    Attributes:
        link: the port.
        words: what is said, and what is answered.
        answer_s: how long the board may take to answer.
        firmware: what it said when it was greeted.
        is_in_step: whether no answer is outstanding.
    """

    def __init__(self, link: SerialLink, words: TemplateWords, answer_s: float) -> None:
        self.link, self.words, self.answer_s = link, words, answer_s
        self.firmware = "typed in"
        self.is_in_step = False

    def greet(self) -> None:
        """Ask who it is, and send the lines for the start.

        Raises:
            DeviceUnrecognised: it does not answer as the template says.
        """
        words = self.words
        if not words.hello.is_empty:
            try:
                said = self.request(words.hello.fill({}), words.hello_answer)
            except DeviceTimeout as error:
                raise DeviceUnrecognised(
                    self.link.device,
                    f"does not answer {words.hello.parts[0]!r} as the template says",
                    "Check `baud`, `line_ending` and `hello_answer`, or type to the board with a terminal.",
                ) from error
            self.firmware = said[0].decode("ascii", "replace").strip()
        for line in words.init:
            self.request(line.fill({}), words.done)

    def knock(self, timeout_s: float | None = None) -> None:
        """Greet it again, where the template can."""
        if not self.words.hello.is_empty:
            self.request(self.words.hello.fill({}), self.words.hello_answer, timeout_s)

    def get_in_step(self, timeout_s: float) -> None:
        """With a board that did not answer: it is greeted, or its answers are let pass.

        Args:
            timeout_s: what is under way may have to end first.
        """
        if self.words.hello.is_empty and not self.is_in_step:
            self.link.listen(self.answer_s)
        self.knock(timeout_s)
        self.is_in_step = True

    def ask_position(self) -> float:
        """The number that the board tells; to be asked only where the template can."""
        # Up to the end of the line, lest half a number be taken for it.
        answer = f"(?:{self.words.where_answer})[^\r\n]*[\r\n]"
        found = self.request(self.words.where.fill({}), answer)
        try:
            return float(found[1])
        except (ValueError, TypeError) as error:
            raise DeviceError(
                self.link.device, f"says where it stands with {found[0]!r}, which is no number"
            ) from error

    def request(self, command: bytes, answer: str, timeout_s: float | None = None) -> re.Match[bytes]:
        """Say something and wait for the answer.

        Raises:
            DeviceRefused: it complains.
            BoardRestarted, DeviceTimeout, DeviceLost, MoveStopped.
        """
        self.send(command)
        return self.await_answer(answer, timeout_s or self.answer_s, command)

    def send(self, command: bytes) -> None:
        """Say something whose answer is waited for later; what came unasked is thrown away."""
        heard = self.link.discard()
        if self.words.banner is not None and self.words.banner.search(heard):
            self.is_in_step = True
            raise BoardRestarted
        self.link.write(self.words.line(command))

    def await_answer(self, answer: str, timeout_s: float, command: bytes) -> re.Match[bytes]:
        """The answer to what was said. Raises as `request`."""
        shown = command.decode("latin-1")
        is_in_step, self.is_in_step = self.is_in_step, False
        found = self.link.wait_for(self.words.expected(answer), timeout_s, shown)
        self.is_in_step = is_in_step
        if found["banner"] is not None:
            raise BoardRestarted
        if found["failed"] is not None:
            said = found["failed"].decode("ascii", "replace")
            raise DeviceRefused(self.link.device, f"answered {said!r} to {shown!r}")
        return found
