"""How one talks to a FabScanPi board: it echoes every byte, then answers, then shows a prompt."""

import re
import time
from collections.abc import Sequence

from app.devices.laser_care import LASER_ANSWER_S, dark_unless_answered
from app.devices.serial_link import SerialLink
from app.errors import DeviceTimeout, DeviceUnrecognised

BAUDS = (115200, 57600, 14400)
# The boot loader takes a second.
_BOOT_S = 1.5
_KNOCK_S = 0.15
# How long a port stays closed, so that opening it gives an edge on DTR, which resets the board.
_CLOSED_S = 0.1
_ECHO_S = 1.0
_ANSWER_S = 1.5
_VERSION = re.compile(rb"M200;\n([\w.]+)\r\n>")
_OTHERS = re.compile(rb"(Horus|Grbl|Marlin|Sardauscan) ?[\w.]*|^start\r?$", re.MULTILINE)
_BOARDS = {"1": "HAT", "2": "Ciclop", "3": "Sanguinololu", "4": "CNC shield", "5": "HAT 2"}


class FabScanDialogue:
    """Request and answer over a port whose baud rate depends on the firmware's version.

    Attributes:
        link: the port; its rate is found by trying.
        version: what the board answers to M200.
        board: kind of board by M201, in words; empty for firmware before 2018, which does not tell.
    """

    def __init__(self, link: SerialLink, bauds: Sequence[int] = BAUDS) -> None:
        self.link, self._bauds = link, tuple(bauds)
        self._prompt = re.compile(rb">\r\n")
        self.version = self.board = ""

    def open(self, extra_s: float = 0.0) -> None:
        """Open the port, which resets the board, at the rate at which it answers.

        Args:
            extra_s: how much longer to ask at each rate; a board that is not reset answers after its move.

        Raises:
            DeviceUnrecognised: it does not answer as such a board does.
        """
        was_open = self.link.is_open
        for baud in self._bauds:
            self.link.close()
            if was_open:
                time.sleep(_CLOSED_S)
            self.link.baud = baud
            self.link.open()
            was_open = True
            if self._greet(_BOOT_S + extra_s):
                # It was right once and will be again.
                self._bauds = (baud, *(other for other in self._bauds if other != baud))
                self.board = _BOARDS.get(self.request("M201").strip(), "")
                return
        self.link.close()
        rates = ", ".join(map(str, sorted(self._bauds)))
        raise DeviceUnrecognised(
            self.link.device,
            f"{self.link.port} does not answer as a FabScanPi board at {rates} baud",
            "Wait until the table stands still, or choose another driver or baud rate.",
        )

    def request(self, command: str) -> str:
        """Say something that may be said twice; return what comes between the echo and the prompt."""
        try:
            return self._request_once(command)
        except DeviceTimeout:
            self._end_line()
            return self._request_once(command)

    def switch(self, on: str, off: str, *, is_on: bool) -> None:
        """Put a laser on or off, in the words for either; out, where the board does not answer."""
        for is_last in (False, True):
            try:
                with dark_unless_answered(self.link, b"\n" + _line(off)):
                    self._request_once(on if is_on else off, LASER_ANSWER_S)
                    return
            except DeviceTimeout:
                if is_last:
                    raise
                self.link.listen(_KNOCK_S, self._prompt)

    def _request_once(self, command: str, timeout_s: float | None = None) -> str:
        timeout_s = timeout_s or _ECHO_S + _ANSWER_S
        ends = time.monotonic() + timeout_s
        self.send(command, min(timeout_s, _ECHO_S))
        return self.await_prompt(command, max(0.0, ends - time.monotonic()))

    def _end_line(self) -> None:
        """One that was left half said."""
        self.link.write(b"\n")
        self.link.listen(_KNOCK_S, self._prompt)

    def send(self, command: str, echo_s: float | None = None) -> None:
        """Say something, and hear that the board has understood every byte."""
        self.link.discard()
        self.write(command)
        self.await_echo(command, echo_s or _ECHO_S)

    def write(self, command: str) -> None:
        """Say something that the board may read later."""
        self.link.write(_line(command))

    def await_echo(self, command: str, timeout_s: float) -> None:
        self.link.wait_for(re.compile(re.escape(_line(command))), timeout_s, command)

    def await_prompt(self, command: str, timeout_s: float) -> str:
        """Wait until the board has done what it echoed."""
        heard = self.link.wait_for(self._answer, timeout_s, command)
        return heard[1].decode("ascii", "replace")

    @property
    def _answer(self) -> re.Pattern[bytes]:
        return re.compile(rb"(.*?)" + self._prompt.pattern, re.DOTALL)

    def _greet(self, patience_s: float) -> bool:
        """Knock until the boot loader is over."""
        ends = time.monotonic() + patience_s
        heard = b""
        while time.monotonic() < ends:
            # The first line end completes what the wire, or an earlier program, left behind.
            self.link.write(b"\nM200;\n")
            heard += self.link.listen(_KNOCK_S, _VERSION)
            if found := _VERSION.search(heard):
                self.version = found[1].decode("ascii")
                # Firmware of 2016 ends its prompt with nothing.
                self._prompt = re.compile(rb">" if self.version.startswith("v.2016") else rb">\r\n")
                return True
            if found := _OTHERS.search(heard):
                self.link.close()
                other = found[0].decode("ascii").strip()
                raise DeviceUnrecognised(
                    self.link.device, f"{self.link.port} is no FabScanPi board; it says {other!r}"
                )
        return False


def _line(command: str) -> bytes:
    return command.encode("ascii", "replace") + b";\n"
