"""Which of the boards with a Horus banner it is, by what it makes of harmless questions."""

import re
from collections.abc import Callable
from dataclasses import dataclass

from app.devices.horus_kind import CloneHorus, HorusKind, read_settings, true_horus
from app.devices.horus_line import BANNER, REPLY_S, BoardRestarted, HorusLine
from app.errors import DeviceTimeout, DeviceUnrecognised

_BOOT_S = 2.5
_ASK_S = 0.25
_LISTING_S = 3.0
_CLONE_SAYS = re.compile(rb"(ok|error:[^\r\n]*)\r\n")
_ACCELERATION, _SAME = 120, 1e-3


@dataclass(frozen=True, slots=True)
class HorusRecognition:
    """What a person has said of the board.

    Attributes:
        resolution: `auto`, `steps` or `degrees`.
        positions_per_turn: of a clone.
        acceleration_deg_s2: to be written to the board; 0 for what it has.
    """

    resolution: str
    positions_per_turn: int
    acceleration_deg_s2: float

    def recognise(self, line: HorusLine, brake_s: float, begin_anew: Callable[[], None]) -> HorusKind:
        """Find out who is behind a port that was just opened.

        Args:
            line: to it.
            brake_s: how long it needs to stand, where opening the port has not reset it.
            begin_anew: called when it is seen to have started.

        Raises:
            DeviceUnrecognised: no Horus.
        """
        link = line.link
        heard = link.listen(_BOOT_S, re.compile(BANNER.pattern + rb"\r\n"))
        banner = BANNER.search(heard)
        if banner is None and b"Grbl" in heard:
            raise DeviceUnrecognised(
                link.device, f"{link.port} is a Grbl board", "Use the driver `grbl` for it."
            )
        line.is_in_step = True
        if banner:
            begin_anew()
        try:
            return self._identify(line, brake_s, banner[1].decode() if banner else "")
        except BoardRestarted:
            # Its boot loader took longer than others.
            begin_anew()
            return self._identify(line, brake_s, "")

    def _identify(self, line: HorusLine, brake_s: float, version: str) -> HorusKind:
        if self._is_clone(line, has_banner=bool(version)):
            return CloneHorus(self.positions_per_turn)
        if not version:
            # It has not been reset, and may be in any state.
            line.halt(brake_s)
            version = _version(line)
        if (status := line.status()) is not None and status.state == "Alarm":
            line.request("$X")
        settings = dict(read_settings(line.request("$$", _LISTING_S)))
        wanted = self.acceleration_deg_s2
        if wanted and abs(settings.get(_ACCELERATION, 0.0) - wanted) > _SAME:
            line.request(f"${_ACCELERATION}={wanted:.3f}")
            settings[_ACCELERATION] = wanted
        return true_horus(f"Horus {version}", settings)

    def _is_clone(self, line: HorusLine, *, has_banner: bool) -> bool:
        if self.resolution != "auto":
            return self.resolution == "degrees"
        link = line.link
        if line.status(asks=2, wait_s=_ASK_S) is not None:
            return False
        if not has_banner:
            try:
                line.reset()
            except DeviceTimeout as error:
                raise DeviceUnrecognised(link.device, f"nothing on {link.port} answers as a Horus") from error
        # A line that the true firmware refuses, and the clone takes for a setting; before it, the end of
        # the line that its questions began.
        link.discard()
        link.write(b"\n$1\n")
        try:
            return link.wait_for(_CLONE_SAYS, REPLY_S, "$1")[1] == b"ok"
        except DeviceTimeout as error:
            raise DeviceUnrecognised(link.device, f"{link.port} has a Horus banner but no answers") from error


def _version(line: HorusLine) -> str:
    said = re.search(r"\[(0\.[12]):", line.request("$I"))
    if said is None:
        raise DeviceUnrecognised(line.link.device, f"{line.link.port} is no Horus, but something like Grbl")
    return said[1]
