"""The dialogue with a Horus board: requests, answers, and what comes unasked."""

import re
import threading
import time
from dataclasses import dataclass

from app.devices.serial_link import SerialLink
from app.errors import DeviceError, DeviceRefused, DeviceTimeout

# A laser whose command is not answered must not burn on while somebody waits.
REPLY_S = 0.5
_STATUS_S = 0.6
_BANNER_S = 2.0
_QUIET_S = 0.03
_POLL_S = 0.01
_ASKS = 3

BANNER = re.compile(rb"Horus ([\d.]+) \['\$' for help\]")
_EVENT = re.compile(
    rb"<(?P<state>\w+),MPos:(?P<x>-?\d+\.\d+),[^>\r\n]*>\r\n"
    rb"|(?P<ok>ok)\r\n|error: (?P<error>[^\r\n]*)\r\n"
    rb"|Horus (?P<banner>[\d.]+) \['\$' for help\]\r\n"
)
_TEXT = re.compile(rb"(?s)(?P<text>.*?)(?:" + _EVENT.pattern + rb")")
_VERSION = rb"\[\d[^\r\n]*\]\r\nok\r\n"
_HELP = rb"ctrl-x \(reset\)\r\nok\r\n"
_FEED = re.compile(r" F([\d.]+)")
_ALARM_LOCK = "Alarm lock"


class BoardRestarted(DeviceError):  # noqa: N818 (a noun, as in app.errors)
    """The board has started anew in the middle of a dialogue: power failed, or somebody reset it."""

    code = "board-restarted"
    hint = "Check the power supply of the board and its motor."

    def __init__(self, device: str) -> None:
        super().__init__(device, "has started anew by itself")


@dataclass(frozen=True, slots=True)
class Status:
    """Answer to `?`.

    Attributes:
        state: Idle, Run, Hold, Queue, Alarm or Check.
        x_deg: where the board counts itself.
    """

    state: str
    x_deg: float


class HorusLine:
    """One line out, its `ok` back. To be used within `link.dialogue()`, except `wish` and `overheard`.

    Attributes:
        link: the port.
        is_in_step: whether no answer is outstanding.
        has_restarted: whether it has started anew by itself and nobody has taken that into account yet.
        has_told_feed: whether a feed rate was sent since the board has last started; it forgets that.
    """

    def __init__(self, link: SerialLink) -> None:
        self.link = link
        self.is_in_step = True
        self.has_told_feed = self.has_restarted = False
        self._news = threading.Condition()
        self._status: Status | None = None
        self._early: re.Match[bytes] | None = None

    def request(self, line: str, timeout_s: float = REPLY_S) -> str:
        """Send a line and wait for its `ok`; returns what came before it.

        Raises:
            DeviceRefused: the board answers with an error.
            BoardRestarted: it has started anew since the last request, or does so now.
            DeviceTimeout, DeviceLost, MoveStopped: as the link.
        """
        self.send(line)
        try:
            return self.answer(line, timeout_s)
        except DeviceRefused as error:
            if _ALARM_LOCK not in error.message or line == "$X":
                raise
        self.request("$X")
        self.send(line)
        return self.answer(line, timeout_s)

    def send(self, line: str) -> None:
        """Send a line whose answer is waited for later; what came unasked is thrown away."""
        if BANNER.search(self.link.discard()):
            raise self._restarted()
        self.is_in_step, self._early = False, None
        if line.startswith("G1F"):
            self.has_told_feed = True
        self.link.write(line.encode("ascii", "replace") + b"\n")

    def answer(self, line: str, timeout_s: float) -> str:
        """The answer to a line that was sent. Raises as `request`."""
        ends, text = time.monotonic() + timeout_s, ""
        while True:
            event = self._early or self._next(ends - time.monotonic(), line)
            self._early = None
            text += event["text"].decode("ascii", "replace")
            if event["banner"]:
                raise self._restarted()
            if event["ok"] or event["error"] is not None:
                self.is_in_step = True
                if event["ok"]:
                    return text
                problem = event["error"].decode("ascii", "replace")
                raise DeviceRefused(self.link.device, f"answers {line!r} with {problem!r}")

    def status(self, asks: int = _ASKS, wait_s: float = _STATUS_S) -> Status | None:
        """Ask where the board is; None when it does not answer, as a clone of it."""
        for _ in range(asks):
            self.link.write(b"?")
            ends = time.monotonic() + wait_s
            while (left := ends - time.monotonic()) > 0.0:
                try:
                    event = self._next(left, "?")
                except DeviceTimeout:
                    break
                if event["banner"]:
                    raise self._restarted()
                if event["state"]:
                    return self._status
                # The answer to the line under way, for who comes to wait for it.
                self._early = event
        return None

    def wish(self, byte: bytes) -> None:
        """Send a real-time byte, from any thread."""
        self.link.write(byte)

    def overheard(self) -> Status | None:
        """Ask where the board is while another thread holds the dialogue and waits for an `ok`."""
        with self._news:
            self._status = None
            self.link.write(b"?")
            self._news.wait_for(lambda: self._status is not None, _STATUS_S)
            return self._status

    def reset(self) -> None:
        """`\\x18`, and wait for the banner. Raises DeviceTimeout."""
        self.link.discard()
        self.wish(b"\x18")
        ends = time.monotonic() + _BANNER_S
        while not self._next(ends - time.monotonic(), "\\x18")["banner"]:
            pass
        # What follows at once is the banner of an earlier reset that was given up waiting for, or the hint
        # of a locked board.
        self.link.listen(_QUIET_S)
        self.has_told_feed, self.is_in_step = False, True

    def halt(self, brake_s: float) -> Status:
        """Bring a board in any state to a standstill, its count exact.

        The way that loses nothing: hold, wait until it stands in Queue, and only then reset.

        Args:
            brake_s: how long the table needs to slow down.
        """
        ends = time.monotonic() + brake_s + REPLY_S
        while True:
            status = self.status()
            if status is None or time.monotonic() > ends:
                raise DeviceTimeout(self.link.device, "!", brake_s + REPLY_S)
            if status.state == "Run":
                self.wish(b"!")
            elif status.state == "Hold":
                time.sleep(_POLL_S)
            elif status.state in ("Queue", "Check"):
                self.reset()
            elif not self.is_in_step:
                self.synchronise()
            else:
                return status

    def synchronise(self) -> None:
        """Throw outstanding answers away: the next ones belong to the next request. The board stands still.

        Raises:
            BoardRestarted: it has, or a feed rate that it was told is forgotten.
        """
        self._ask_apart("$I", _VERSION, _STATUS_S)
        feed = _FEED.search(self.request("$G"))
        if self.has_told_feed and feed is not None and not float(feed[1]):
            raise self._restarted()

    def synchronise_clone(self, wait_s: float) -> None:
        """As `synchronise`, for the clone, which answers in order and only its help differs from `ok`.

        Args:
            wait_s: how long the move under way may last.
        """
        self._ask_apart("$", _HELP, wait_s)

    def _ask_apart(self, question: str, end: bytes, wait_s: float) -> None:
        """Ask something whose answer is like no other."""
        expected = re.compile(b"(" + BANNER.pattern + b")|" + end)
        for number in range(_ASKS):
            if BANNER.search(self.link.discard()):
                raise self._restarted()
            self.link.write(question.encode("ascii") + b"\n")
            try:
                found = self.link.wait_for(expected, wait_s, question)
            except DeviceTimeout:
                continue
            if found[1]:
                raise self._restarted()
            if number and BANNER.search(self.link.listen(_QUIET_S)):
                raise self._restarted()
            self.is_in_step = True
            return
        raise DeviceTimeout(self.link.device, question, _ASKS * wait_s)

    def _next(self, timeout_s: float, command: str) -> re.Match[bytes]:
        found = self.link.wait_for(_TEXT, timeout_s, command)
        if found["state"]:
            with self._news:
                self._status = Status(found["state"].decode("ascii"), float(found["x"]))
                self._news.notify_all()
        return found

    def _restarted(self) -> BoardRestarted:
        self.has_told_feed, self.is_in_step, self.has_restarted = False, True, True
        return BoardRestarted(self.link.device)
