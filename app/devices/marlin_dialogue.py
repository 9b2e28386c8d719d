"""How one talks to Marlin: a line, what it says to it, and an `ok` that may carry values."""

import re
import time
from dataclasses import dataclass

from app.devices.serial_link import SerialLink
from app.errors import DeviceError, DeviceTimeout, DeviceUnrecognised

# A busy board says so every two seconds.
ANSWER_S = 2.5
# After the boot loader, version 1.1.1 with a display takes no command for 5.9 s.
_START_S, _SILENCE_S = 10.0, 3.0
_KNOCK_S = 1.2
_BUSY = "echo:busy"
_WHO = re.compile(rb"FIRMWARE_NAME:\s*([^\r\n]*?)(?:\s*\(|\s+[A-Z_]+:|\r?\n)")
_OTHERS = re.compile(rb"(?:Horus|Grbl|GrblHAL|Sardauscan) V?\d[\w.]*")
_START = re.compile(rb"(?:^|[\r\n])start\r?\n")
_SIGNS = re.compile(_START.pattern + rb"|echo:|Marlin")
_HALTED = re.compile(rb"Error:[^\r\n]*(?:halted|kill\(\))[^\r\n]*")
_NEWS = re.compile(_START.pattern + b"|" + _HALTED.pattern)
_POSITION = re.compile(
    rb"E:\s*(?P<e>-?[\d.]+)\s+Count\s+\w:\s*(?P<count>-?\d+)[^\r\n]*\r?\n(?:[^\r\n]*\r?\n)*?ok|"
    + b"|".join((_BUSY.encode(), _NEWS.pattern))
)


class MarlinRestarted(Exception):  # noqa: N818 (an event, not an error)
    """`start` came in mid-dialogue: settings, position and lasers are gone."""


@dataclass(frozen=True, slots=True)
class MarlinPosition:
    """Answer to M114.

    Attributes:
        count: pulses of X.
        extruder: of E, units; where it was told to go.
    """

    count: int
    extruder: float


class MarlinDialogue:
    """Request and answer, over a link that its owner opens and closes.

    Attributes:
        link: the port.
        firmware: name and version as M115 tells them.
        is_in_step: whether the next `ok` is certain to be that to the next question.
    """

    def __init__(self, link: SerialLink) -> None:
        self.link = link
        self.firmware = ""
        self.is_in_step = True

    def greet(self) -> None:
        """Ask who it is until it answers; after a reset there are boot loader, texts and splash screen first.

        Raises:
            DeviceUnrecognised: it is no Marlin, or nothing answers.
        """
        began = knocked = time.monotonic()
        self.link.write(b"\nM115\n")
        heard, has_started = b"", False
        while time.monotonic() - began < (_START_S if _SIGNS.search(heard) else _SILENCE_S):
            heard += self.link.listen(0.1, _WHO)
            if who := _WHO.search(heard):
                self.firmware = who[1].decode("ascii", "replace")
                # Later answers to the same question are still to come.
                self.find_position()
                return
            if other := _OTHERS.search(heard):
                said = other[0].decode("ascii")
                raise DeviceUnrecognised(self.link.device, f"{self.link.port} is no Marlin; it says {said!r}")
            if not has_started and _START.search(heard):
                # What comes after the boot loader is kept, so one more question is enough.
                has_started, knocked = True, time.monotonic()
                self.link.write(b"\nM115\n")
            elif not has_started and time.monotonic() - knocked > _KNOCK_S:
                knocked = time.monotonic()
                self.link.write(b"\nM115\n")
        raise DeviceUnrecognised(self.link.device, f"{self.link.port} does not answer as Marlin does")

    def ask(self, line: str, timeout_s: float | None = None) -> list[str]:
        """Say something that may be said twice; return what comes before the `ok`, and what it carries.

        Args:
            timeout_s: without a sign of life; the usual one by default.

        Raises:
            MarlinRestarted: the board has reset itself; it has not done it.
            DeviceError: the board has halted itself.
        """
        try:
            return self.ask_once(line, timeout_s)
        except DeviceTimeout:
            return self.ask_once(line, timeout_s)

    def ask_once(self, line: str, timeout_s: float | None = None) -> list[str]:
        """As `ask`, for what must not be said twice."""
        if not self.is_in_step:
            self.find_position()
        self.heed(self.link.discard())
        self.is_in_step = False
        timeout_s = timeout_s or ANSWER_S
        self.link.write(line.encode("ascii", "replace") + b"\n")
        answer: list[str] = []
        ends = time.monotonic() + timeout_s
        while True:
            try:
                said = self.link.read_line(max(0.0, ends - time.monotonic()), line)
            except DeviceTimeout:
                raise DeviceTimeout(self.link.device, line, timeout_s) from None
            self.heed(b"\n" + said.encode("ascii", "replace") + b"\n")
            if said.startswith(_BUSY):
                ends = time.monotonic() + timeout_s
            elif said.startswith("ok"):
                self.is_in_step = True
                return [*answer, said[2:].strip()] if said[2:].strip() else answer
            elif said:
                answer.append(said)

    def find_position(self) -> MarlinPosition:
        """Ask where it is, which it answers when it stands; brings both ends into step again."""
        self.heed(self.link.discard())
        # The first line end completes what the wire may have left half said.
        self.link.write(b"\nM114\n")
        while True:
            told = self.link.wait_for(_POSITION, ANSWER_S, "M114")
            if told["count"] is not None:
                self.is_in_step = True
                return MarlinPosition(int(told["count"]), float(told["e"]))
            self.heed(told[0])

    def wait(self, duration_s: float) -> None:
        """Let time pass, unless the board restarts or halts."""
        try:
            self.heed(self.link.wait_for(_NEWS, duration_s, "a move")[0])
        except DeviceTimeout:
            return

    def heed(self, heard: bytes) -> None:
        """News that nobody asked for. Raises as `ask`."""
        if halted := _HALTED.search(heard):
            raise self._halted(halted[0].decode("ascii", "replace"))
        if _START.search(heard):
            raise MarlinRestarted

    def _halted(self, words: str) -> DeviceError:
        return DeviceError(
            self.link.device,
            f"the board has halted itself: {words!r}",
            "A temperature sensor may read too hot or be missing, or somebody sent M112. Mend that, and "
            "connect again, which resets the board.",
        )
