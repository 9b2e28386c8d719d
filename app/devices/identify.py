"""Which firmware is behind a port: listen to its banner first, then ask what can do no harm.

A board that is opened usually starts anew and says who it is. A silent one is sent a question mark and a line
end, which every firmware answers in its own way and none acts on; what only one firmware understands is sent
only to a board that has shown itself to be of that kind. A board that speaks at another rate is opened anew
at that rate and listened to.
"""

import contextlib
import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import TracebackType
from typing import Self

import serial

from app.devices.ports import resolve_port
from app.devices.serial_link import GONE, open_error
from app.errors import DeviceLost

_BAUD = 115200
_BANNER_S = 1.9
_BANNER_AGAIN_S = 1.6
# From the first byte that makes no sense on.
_GARBAGE_S = 0.35
# What the lines do when a port is opened may look like some bytes.
_GLITCH_S, _GLITCH_BYTES = 0.3, 4
_ANSWER_S = 0.2
_TEXT_S = 0.6
_LOCK_LINE_S = 0.05
_REOPEN_S = 0.1
_POLL_S = 0.02
QUESTION = b"?\r\n"
RESET = b"\x18"
PING = b"\xd2"
_LASER_OFF = b"\xc8"
_FIRST_FABSCAN_BAUD = 9600
# Rates of boards that say garbage at 115200: few bytes come from a slow board, many from a fast one.
_AFTER_LITTLE = (9600, 250000, 57600, 38400, 19200, 4800)
_AFTER_MUCH = (250000, 57600, 9600, 38400, 19200, 4800)
_MANY_BYTES = 24
# Rates of boards that say nothing at their start: FabScanPi on a Ciclop board (whose adapter is an FTDI), and
# on other boards; then Marlin.
_FTDI = 0x0403
_SILENT_ON_FTDI, _SILENT = (14400, 57600, 250000), (57600, 14400, 250000)


@dataclass(frozen=True, slots=True)
class Identity:
    """What is behind a port.

    Attributes:
        driver: that handles it; empty where it is no board that anybody here knows.
        firmware: what it says of itself, or what it seems to be.
        baud: its rate, bits per second; 0 where unknown.
        notes: what a person should know of it, as sentences.
        options: of the driver, beyond the port.
    """

    driver: str
    firmware: str
    baud: int
    notes: tuple[str, ...] = ()
    options: Mapping[str, object] = field(default_factory=dict)


def identify(port: str, usb_id: tuple[int, int] | None = None) -> Identity:
    """Find out what is behind a port, without switching a laser or moving a table.

    Args:
        port: path or URL.
        usb_id: vendor and product of its adapter, where known; it makes the search quicker.

    Raises:
        DeviceNotFound, DeviceDenied, DeviceError: the port cannot be opened, or went away.
    """
    try:
        with _Ear(port, _BAUD) as ear:
            heard = ear.listen(_BANNER_S, _is_clear)
            if (found := _by_banner(ear, heard)) is not None:
                return found
            is_garbled = _is_garbage(heard)
            if not is_garbled and _is_chatter(heard):
                return _stranger(heard, _BAUD)
            if not is_garbled and (found := _by_asking(ear, _rates(usb_id))) is not None:
                return found
        if is_garbled:
            return _at_another_rate(port, heard)
    except GONE as error:
        raise DeviceLost(port, "the port went away while it was listened to") from error
    return _silent()


class _Ear:
    """An open port, and everything that it has said since."""

    def __init__(self, port: str, baud: int) -> None:
        try:
            self._port = serial.serial_for_url(
                resolve_port(port), baud, timeout=_POLL_S, write_timeout=1.0,
                **({} if "://" in port else {"exclusive": True}),  # type: ignore[arg-type]
            )  # fmt: skip
        except (*GONE, ValueError) as error:
            raise open_error(port, port, error) from error
        self._opened_s = time.monotonic()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with contextlib.suppress(*GONE):
            self._port.close()

    @property
    def baud(self) -> int:
        return int(self._port.baudrate)

    @baud.setter
    def baud(self, baud: int) -> None:
        self._port.baudrate = baud

    def listen(self, duration_s: float, is_enough: Callable[[bytes, int], bool]) -> bytes:
        """What arrives until it is enough, or the time is over; garbage shortens it."""
        heard = bytearray()
        ends = time.monotonic() + duration_s
        garbled_since: float | None = None
        while (now := time.monotonic()) < ends and not is_enough(bytes(heard), self.baud):
            heard += self._port.read(max(1, self._port.in_waiting))
            if now < self._opened_s + _GLITCH_S:
                if len(heard) < _GLITCH_BYTES and _is_garbage(bytes(heard)):
                    heard.clear()
            elif garbled_since is None and _is_garbage(bytes(heard)):
                garbled_since = now
                ends = min(ends, now + _GARBAGE_S)
        return bytes(heard)

    def ask(self, question: bytes, pattern: bytes, timeout_s: float = _ANSWER_S) -> re.Match[bytes] | None:
        """Say something; what was answered, or None."""
        return re.search(pattern, self.hear_answer(question, pattern, timeout_s), re.DOTALL)

    def hear_answer(self, question: bytes, pattern: bytes, timeout_s: float = _ANSWER_S) -> bytes:
        self._port.reset_input_buffer()
        self._port.write(question)
        return self.listen(timeout_s, lambda heard, _: bool(re.search(pattern, heard, re.DOTALL)))


def _by_banner(ear: _Ear, heard: bytes) -> Identity | None:
    """Who it is by what it said at its start, and what more it tells when asked."""
    if ear.baud == _FIRST_FABSCAN_BAUD and heard.strip(b"\x00\xff") == b"\xd3":
        # Opening the port has put its laser on; nobody has asked for that.
        ear.hear_answer(_LASER_OFF + PING, b"\xd3")
        return _first_fabscan(ear)
    for pattern, closer in _BANNERS:
        match = re.search(pattern, heard)
        if match is not None:
            return closer(ear, heard, match)
    return None


def _by_asking(ear: _Ear, rates: Sequence[int]) -> Identity | None:
    """Who it is by how it answers a question mark; at the usual rate first."""
    for baud in (_BAUD, *rates):
        ear.baud = baud
        answer = ear.hear_answer(QUESTION, _ANY_ANSWER)
        for pattern, closer in _ANSWERS:
            match = re.search(pattern, answer)
            if match is not None:
                return closer(ear, answer, match)
        if _is_garbage(answer):
            continue
        if answer:
            return _stranger(answer, baud)
        # Boards that take no question mark, and a Grbl after a limit switch, answer this with their banner.
        if baud == _BAUD and (found := _by_banner(ear, ear.hear_answer(RESET, _BANNER_END))) is not None:
            return found
    ear.baud = _FIRST_FABSCAN_BAUD
    if ear.hear_answer(PING, b"\xd3") == b"\xd3":
        return _first_fabscan(ear)
    return None


def _at_another_rate(port: str, heard: bytes) -> Identity:
    """Start the board again and again, until what it says makes sense."""
    for baud in _AFTER_MUCH if len(heard) >= _MANY_BYTES else _AFTER_LITTLE:
        # The reset line needs a moment to fall.
        time.sleep(_REOPEN_S)
        with _Ear(port, baud) as ear:
            again = ear.listen(_BANNER_AGAIN_S, _is_clear)
            if not again:
                # Opening does not start it: what was heard had another cause.
                return _by_asking(ear, _SILENT) or _silent()
            if (found := _by_banner(ear, again)) is not None:
                return found
            if _is_chatter(again):
                return _stranger(again, baud)
    return _stranger(heard, 0)


def _horus(ear: _Ear, heard: bytes, match: re.Match[bytes]) -> Identity:
    """The true firmware answers a question mark; its look-alike does not, and knows whole degrees only."""
    status = ear.ask(QUESTION, rb"<(\w+),")
    version = match[1].decode()
    if status is None:
        note = "It has the banner of Horus and answers less: it turns by whole degrees and has two lasers."
        return _board("horus", f"Horus {version}, look-alike", ear, (note,))
    return _board("horus", f"Horus {version}", ear, _lock_note(heard, status[1]))


def _horus_awake(ear: _Ear, heard: bytes, match: re.Match[bytes]) -> Identity:
    told = ear.ask(b"$I\n", rb"\[([\d.]+):", _TEXT_S)
    version = f" {told[1].decode()}" if told else ""
    return _board("horus", f"Horus{version}", ear, _lock_note(heard, match[1]))


def _grbl(ear: _Ear, heard: bytes, match: re.Match[bytes]) -> Identity:
    name, version = match[1].decode(), match[2].decode()
    heard += ear.listen(_LOCK_LINE_S, lambda more, _: b"unlock]" in more)
    return _board("grbl", f"{name} {version}", ear, _lock_note(heard, b""))


def _grbl_awake(ear: _Ear, heard: bytes, match: re.Match[bytes]) -> Identity:
    told = ear.hear_answer(b"$I\n", rb"\]\s*ok\r\n", _TEXT_S)
    version = re.search(rb"\[VER:([\w.]+)", told)
    name = "GrblHAL" if b"GrblHAL" in told or b"grblHAL" in told or b"NEWOPT" in told else "Grbl"
    firmware = f"{name} {version[1].decode()}" if version else name
    return _board("grbl", firmware, ear, _lock_note(heard, match[1]))


def _marlin(ear: _Ear, heard: bytes, match: re.Match[bytes]) -> Identity:
    """It says much at its start; the version is in it, or is asked for."""
    heard += ear.listen(_TEXT_S, lambda more, _: b"\n" in more and bool(_MARLIN.search(heard + more)))
    named = _MARLIN.search(heard)
    if named is None:
        return _marlin_awake(ear, heard, match)
    return _board("marlin", f"Marlin {named[1].decode()}", ear)


def _marlin_awake(ear: _Ear, heard: bytes, match: re.Match[bytes]) -> Identity:
    told = ear.ask(b"M115\n", rb"FIRMWARE_NAME:\s*([^\r\n]*?)(?:\s*\(|\s+[A-Z_]+:|\r|\n)", _TEXT_S)
    firmware = told[1].decode("ascii", "replace") if told else "Marlin or a relative of it"
    return _board("marlin", firmware, ear)


def _sardauscan(ear: _Ear, heard: bytes, match: re.Match[bytes]) -> Identity:
    version = f" {match[1].decode()}" if match.groups() else ""
    return _board("sardauscan", f"Sardauscan{version}", ear, tells_baud=False)


def _fabscan(ear: _Ear, heard: bytes, match: re.Match[bytes]) -> Identity:
    version = ear.ask(b"M200;\n", rb"M200;\s*([^\s>]+)\s*>")
    board = ear.ask(b"M201;\n", rb"M201;\s*(\d+)\s*>")
    firmware = f"FabScanPi {version[1].decode('ascii', 'replace')}" if version else "FabScanPi"
    if board:
        number = int(board[1])
        firmware += f" on board {number} ({_FABSCAN_BOARDS.get(number, 'unknown')})"
    return Identity("fabscan", firmware, ear.baud, options={"baud": ear.baud})


def _first_fabscan(ear: _Ear) -> Identity:
    note = "Its laser is on after every start; the driver puts it off."
    return _board("fabscan100", "FabScan100", ear, (note,), tells_baud=False)


def _silent() -> Identity:
    note = 'Is the board\'s own power on? For a board of another kind, there is the driver "template".'
    return Identity("", "says nothing and answers nothing", 0, (note,))


def _stranger(heard: bytes, baud: int) -> Identity:
    """Something that speaks, and not as any board here does."""
    if _NMEA.search(heard):
        return Identity("", "a GPS receiver or another NMEA device", baud, ("It is no scanner board.",))
    if not baud:
        note = "It speaks at a rate that was not tried. Press its reset button and run the command again."
        return Identity("", "sends what makes no sense at any usual rate", 0, (note,))
    lines = [line for line in heard.decode("ascii", "replace").splitlines() if line.strip()]
    said = lines[0].strip()[:60] if lines else ""
    return Identity("", f"unknown; it says {said!r}", baud, ('If it is a board, use the driver "template".',))


def _board(
    driver: str, firmware: str, ear: _Ear, notes: tuple[str, ...] = (), *, tells_baud: bool = True
) -> Identity:
    """A board; drivers that find the rate themselves, or have only one, are not told it."""
    options = {"baud": ear.baud} if tells_baud and ear.baud != _BAUD else {}
    return Identity(driver, firmware, ear.baud, notes, options)


def _lock_note(heard: bytes, state: bytes) -> tuple[str, ...]:
    is_locked = b"to unlock]" in heard or state.lower().startswith(b"alarm")
    return ("It is locked at its start; the driver unlocks it.",) if is_locked else ()


def _rates(usb_id: tuple[int, int] | None) -> tuple[int, ...]:
    return _SILENT_ON_FTDI if usb_id is not None and usb_id[0] == _FTDI else _SILENT


def _is_clear(heard: bytes, baud: int) -> bool:
    """Whether what was said at the start is somebody's banner."""
    if baud == _FIRST_FABSCAN_BAUD and heard.strip(b"\x00\xff") == b"\xd3":
        return True
    return bool(_BANNER_WHOLE.search(heard) or _NMEA.search(heard))


def _is_garbage(heard: bytes) -> bool:
    """Whether a text was read at a wrong rate."""
    strange = sum(not (0x20 <= byte < 0x7F or byte in b"\t\r\n") for byte in heard)
    return strange > 0.2 * len(heard)


def _is_chatter(heard: bytes) -> bool:
    """Whether something speaks that is nobody's banner."""
    return len(heard.strip()) >= 4 and not _is_garbage(heard)


_Closer = Callable[[_Ear, bytes, re.Match[bytes]], Identity]
_BANNERS: Sequence[tuple[bytes, _Closer]] = (
    (rb"Horus (\d[\w.]*)", _horus),
    (rb"(Grbl|GrblHAL|grblHAL) (\d[\w.]*) \[", _grbl),
    (rb"Sardauscan V(\S+)", _sardauscan),
    (rb"(?:^|[\r\n])start\r?\n", _marlin),
    (rb"Marlin \d", _marlin),
)
_ANSWERS: Sequence[tuple[bytes, _Closer]] = (
    (rb"<(\w+),[^>]*MPos", _horus_awake),
    (rb"<([\w:]+)\|", _grbl_awake),
    (rb"echo:\s*Unknown command", _marlin_awake),
    (rb"Hun\?", _sardauscan),
    (rb"\?\r\s*>", _fabscan),
)
_ANY_ANSWER = rb"<[^>]*>\s*(?:ok\s*)*$|Unknown command[^\n]*\n|Hun\?\r?\n|\?\r\s*>[\s>]*$"
_BANNER_END = rb"help\]\r\n"
_BANNER_WHOLE = re.compile(
    rb"(?:Horus|Grbl|GrblHAL|grblHAL) \d[^\r\n]*\][\r\n]|Sardauscan V[^\r\n]*[\r\n]|(?:^|[\r\n])start\r?\n"
)
_MARLIN = re.compile(rb"Marlin (?:bugfix-)?(\d\S*)[\s]")
_NMEA = re.compile(rb"\$[A-Z]{2}[A-Z0-9]{3},[ -~]*")
_FABSCAN_BOARDS = {1: "HAT", 2: "Ciclop", 3: "Sanguinololu", 4: "CNC shield", 5: "HAT 2"}
