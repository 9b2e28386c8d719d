"""How one talks to a FabScanPi board: it echoes every byte, then answers, then shows a prompt."""

import re
import time

from app.devices.serial_link import SerialLink
from app.errors import DeviceTimeout, DeviceUnrecognised

BAUDS = (115200, 57600, 14400)
# The boot loader takes a second.
BOOT_S = 1.5
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
        link: the port; another object after the baud rate has been found.
        version: what the board answers to M200.
        board: kind of board by M201, in words; empty for firmware before 2018, which does not tell.
    """

    def __init__(self, port: str, name: str, baud: int) -> None:
        self._port, self._name = port, name
        self._bauds: tuple[int, ...] = (baud,) if baud else BAUDS
        self._prompt = re.compile(rb">\r\n")
        self.link = SerialLink(port, self._bauds[0], name)
        self.version = self.board = ""

    def open(self, patience_s: float = BOOT_S) -> None:
        """Open the port, which resets the board, at the rate at which it answers.

        Args:
            patience_s: how long to ask at each rate; a board that is not reset answers after its move.

        Raises:
            DeviceUnrecognised: it does not answer as such a board does.
        """
        was_open = self.link.is_open
        for baud in self._bauds:
            self.link.close()
            if was_open:
                time.sleep(_CLOSED_S)
            # The same link as long as the rate is right, as other threads may wait for it.
            if self.link.baud != baud:
                self.link = SerialLink(self._port, baud, self._name)
            self.link.open()
            was_open = True
            if self._greet(patience_s):
                # It was right once and will be again.
                self._bauds = (baud, *(other for other in self._bauds if other != baud))
                self.board = _BOARDS.get(self.request("M201").strip(), "")
                return
        self.link.close()
        rates = ", ".join(map(str, sorted(self._bauds)))
        raise DeviceUnrecognised(
            self._name,
            f"{self._port} does not answer as a FabScanPi board at {rates} baud",
            "Wait until the table stands still, or choose another driver or baud rate.",
        )

    def request(self, command: str, timeout_s: float = _ANSWER_S) -> str:
        """Say something that may be said twice; return what comes between the echo and the prompt."""
        try:
            self.send(command)
            return self.await_prompt(command, timeout_s)
        except DeviceTimeout:
            # Ends a line that was left half said.
            self.link.write(b"\n")
            self.link.listen(_KNOCK_S, self._prompt)
            self.send(command)
            return self.await_prompt(command, timeout_s)

    def send(self, command: str, echo_s: float = _ECHO_S) -> None:
        """Say something, and hear that the board has understood every byte."""
        self.link.discard()
        self.write(command)
        self.await_echo(command, echo_s)

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
                raise DeviceUnrecognised(self._name, f"{self._port} is no FabScanPi board; it says {other!r}")
        return False


def _line(command: str) -> bytes:
    return command.encode("ascii", "replace") + b";\n"
