"""Talking to Grbl 1.1 and grblHAL: one line at a time, every `ok` counted, late answers thrown away."""

import re
import time
from collections.abc import Callable
from dataclasses import dataclass

from app.devices.serial_link import SerialLink
from app.errors import DeviceError, DeviceRefused, DeviceTimeout, DeviceUnrecognised

ANSWER_S = 2.0
# The boot loader takes a second, some two.
_BANNER_S = 2.5
_RESET_S = 2.0
_AFTER_BANNER_S = 0.05
# Offsets come in every thirtieth report at least.
_REPORTS_WITHOUT_OFFSET = 31
_LOCKED = 9

_BANNER = re.compile(rb"(Grbl(?:HAL)?) (\d\S*) \[[^\r\n]*\r?\n", re.IGNORECASE)
_ALARM = re.compile(rb"ALARM:(\d+)\r?\n")
_REPORT = re.compile(rb"<(?P<report>[^<>\r\n]*)>\r?\n|(?P<banner>" + _BANNER.pattern + rb")", re.IGNORECASE)
_ALARM_IS_TOLD = re.compile(rb"to continue\]\r?\n|to unlock\]\r?\n|\[MSG:\d+[^\r\n]*\]\r?\n")
_MODAL = re.compile(rb"\[GC:[^\r\n]*F(?P<feed>\d+(?:\.\d+)?)[^\r\n]*\r?\n(?s:.*?)ok\r?\n")
_SETTING = re.compile(r"\$(\d+)=(-?[\d.]+)")
_ERROR = re.compile(r"error:(\d+)")
_MEANINGS = {
    1: "expected a command letter", 2: "bad number", 3: "unknown $ command", 4: "negative value",
    8: "the board is not idle", 9: "locked", 15: "jog target out of travel", 20: "unsupported command",
    22: "no feed rate",
}  # fmt: skip


class BoardRestarted(Exception):  # noqa: N818 (an event, not an error)
    """The board's banner came in mid-dialogue: its count, modal state and lasers begin anew."""


class BoardAlarmed(Exception):  # noqa: N818 (an event, not an error)
    """The board has stopped by itself.

    Attributes:
        number: Grbl's; 1 a limit switch, 2 beyond the travel, 3 a reset in mid-move.
    """

    def __init__(self, number: int) -> None:
        super().__init__(f"ALARM:{number}")
        self.number = number


class BoardLocked(Exception):  # noqa: N818 (an event, not an error)
    """It takes no G-code before it is unlocked."""


@dataclass(frozen=True, slots=True)
class GrblStatus:
    """One answer to `?`.

    Attributes:
        state: `Idle`, `Run`, `Hold`, `Jog`, `Alarm`, `Sleep`, ….
        detail: number behind it; a hold is over when it is 0.
        machine: position on each axis, in the board's units; none where the report has none.
        work, offset: position in the work's coordinates, and where their zero is.
    """

    state: str
    detail: str
    machine: tuple[float, ...] = ()
    work: tuple[float, ...] = ()
    offset: tuple[float, ...] = ()

    @property
    def is_held(self) -> bool:
        return self.state == "Hold" and self.detail in ("", "0")

    @property
    def is_moving(self) -> bool:
        return self.state in ("Run", "Jog", "Home") or (self.state == "Hold" and not self.is_held)


def parse_status(text: str) -> GrblStatus:
    """The inside of `<…>`; fields may stand in any order, unknown ones are passed over."""
    name, *fields = text.split("|")
    state, _, detail = name.partition(":")
    places: dict[str, tuple[float, ...]] = {}
    for entry in fields:
        key, _, value = entry.partition(":")
        if key in ("MPos", "WPos", "WCO"):
            try:
                places[key] = tuple(float(number) for number in value.split(","))
            except ValueError:
                continue
    return GrblStatus(state, detail, places.get("MPos", ()), places.get("WPos", ()), places.get("WCO", ()))


@dataclass(slots=True)
class GrblDialogue:
    """The board at the other end of a link. All but `reset_blindly` belongs into a dialogue of the link.

    Attributes:
        link: to the board.
        firmware: what it calls itself, such as `Grbl 1.1h`.
        units_per_inch: 25.4 where its reports are in inches, else 1.
        is_in_step: whether the next answer is certain to be that to the next question.
    """

    link: SerialLink
    firmware: str = ""
    units_per_inch: float = 1.0
    is_in_step: bool = True
    _offset: tuple[float, ...] = ()

    def greet(self) -> bool:
        """Find the board behind a port just opened; whether opening has reset it.

        Raises:
            DeviceUnrecognised: nothing answers, or something else.
        """
        self.is_in_step, self._offset = False, ()
        heard = self.link.listen(_BANNER_S, _BANNER)
        if found := _BANNER.search(heard):
            self._learn_name(found)
            # Lines of its start-up blocks follow at once.
            self.link.listen(_AFTER_BANNER_S)
            self.is_in_step = True
            return True
        if heard.strip() and not heard.isascii():
            # Not one byte is sent: at a wrong rate it may arrive as the one that switches a laser.
            raise DeviceUnrecognised(
                self.link.device,
                f"speaks, but not at {self.link.baud} baud",
                "Set `baud` to the rate of this board; for Grbl it is usually 115200.",
            )
        try:
            self.status(1.0)
        except (DeviceTimeout, BoardRestarted):
            try:
                self.reset()
            except DeviceTimeout as error:
                raise DeviceUnrecognised(self.link.device, "is no Grbl board, or it is dead") from error
            return True
        return False

    def request(
        self, line: str, timeout_s: float | None = None, on_sent: Callable[[], None] | None = None
    ) -> list[str]:
        """Send a line and wait for its `ok`; what came before that, line by line.

        Args:
            on_sent: called when the line is on its way, and has perhaps its effect.

        Raises:
            DeviceRefused: with Grbl's number; on grblHAL the error is cleared.
            BoardRestarted, BoardAlarmed, BoardLocked, DeviceTimeout, DeviceLost, MoveStopped.
        """
        self._heed(self.link.discard())
        # LF alone: Grbl answers CR and LF each with an `ok`.
        self.link.write(line.encode("ascii", "replace") + b"\n")
        if on_sent is not None:
            on_sent()
        timeout_s = timeout_s or ANSWER_S
        ends_s, heard = time.monotonic() + timeout_s, list[str]()
        in_step, self.is_in_step = self.is_in_step, False
        while True:
            said = self._read_line(ends_s, line, timeout_s)
            if said.startswith(">"):
                continue
            if said.endswith("ok"):
                self.is_in_step = in_step
                return heard
            if found := _ERROR.search(said):
                self.is_in_step = in_step
                self._clear_error()
                if int(found[1]) == _LOCKED:
                    raise BoardLocked
                raise self._refusal(line, int(found[1]))
            heard.append(said)

    def status(self, timeout_s: float | None = None) -> GrblStatus:
        """Ask where it stands; it answers in mid-move too.

        Raises:
            BoardRestarted, DeviceTimeout, DeviceLost, MoveStopped.
        """
        for _ in range(_REPORTS_WITHOUT_OFFSET):
            self._heed(self.link.discard())
            self.link.write(b"?")
            found = self.link.wait_for(_REPORT, timeout_s or ANSWER_S, "?")
            if found["report"] is None:
                self._heed(found["banner"])
            status = parse_status(found["report"].decode("ascii", "replace"))
            self._offset = status.offset or self._offset
            machine = status.machine
            if not machine and len(self._offset) == len(status.work):
                machine = tuple(a + b for a, b in zip(status.work, self._offset, strict=True))
            if machine:
                scaled = tuple(self.units_per_inch * at for at in machine)
                return GrblStatus(status.state, status.detail, scaled)
        raise DeviceError(self.link.device, "does not tell its position", "Set $10=1 on the board.")

    def reset(self) -> None:
        """Start the board's program anew; its count stays, everything else is as after switching on.

        Raises:
            DeviceTimeout: no banner came.
        """
        self.link.discard()
        self.link.write(b"\x18")
        found = self.link.wait_for(_BANNER, _RESET_S, "\\x18")
        self._learn_name(found)
        self.is_in_step, self._offset = True, ()

    def reset_after_alarm(self) -> None:
        """As `reset`, once the board has said that it may be: half a second after the alarm."""
        self.link.listen(1.0, _ALARM_IS_TOLD)
        try:
            self.reset()
        except DeviceTimeout:
            self.reset()

    def get_in_step(self) -> None:
        """Make sure that the next answer is that to the next question.

        Raises:
            BoardRestarted: no feed rate is set, which only a start of the board forgets.
        """
        if self.is_in_step:
            return
        self._heed(self.link.discard())
        self.link.write(b"\n$G\n")
        found = self.link.wait_for(_MODAL, ANSWER_S, "$G")
        self.is_in_step = True
        if float(found["feed"]) == 0.0:
            raise BoardRestarted

    def unlock(self) -> None:
        self.request("$X")

    def settings(self) -> dict[int, float]:
        """All `$` numbers."""
        found = (_SETTING.match(line) for line in self.request("$$", 5.0))
        return {int(match[1]): float(match[2]) for match in found if match}

    def _read_line(self, ends_s: float, command: str, timeout_s: float) -> str:
        left = ends_s - time.monotonic()
        if left <= 0.0:
            raise DeviceTimeout(self.link.device, command, timeout_s)
        try:
            said = self.link.read_line(left, command)
        except DeviceTimeout as error:
            raise DeviceTimeout(self.link.device, command, timeout_s) from error
        self._heed(said.encode("ascii", "replace") + b"\n")
        return said

    def _heed(self, heard: bytes) -> None:
        """News that nobody asked for."""
        banner = None
        for banner in _BANNER.finditer(heard):
            self._learn_name(banner)
        if banner is not None:
            self.is_in_step, self._offset = True, ()
            raise BoardRestarted
        if found := _ALARM.search(heard):
            raise BoardAlarmed(int(found[1]))

    def _learn_name(self, banner: re.Match[bytes]) -> None:
        name = "grblHAL" if banner[1].lower() == b"grblhal" else "Grbl"
        self.firmware = f"{name} {banner[2].decode('ascii', 'replace')}"

    def _clear_error(self) -> None:
        """grblHAL repeats an error for every line until an empty one comes; Grbl just says ok to it."""
        self.link.write(b"\n")
        try:
            self.link.wait_for(re.compile(rb"ok\r?\n"), ANSWER_S, "an empty line")
        except DeviceTimeout:
            self.is_in_step = False

    def _refusal(self, line: str, number: int) -> DeviceRefused:
        meaning = _MEANINGS.get(number, "see the list of Grbl's errors")
        return DeviceRefused(self.link.device, f"refused {line!r} with error {number} ({meaning})")
