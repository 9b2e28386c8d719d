"""grblHAL: Grbl's successor for larger chips, with a longer queue and an error that stays."""

from collections.abc import Generator
from typing import ClassVar

from app.simulation.firmware.dialects.grbl import Grbl
from app.simulation.firmware.kernel import FIRMWARES


class GrblHal(Grbl):
    """As Grbl, but CRLF is one line end, errors latch, and the status has more fields.

    Attributes:
        latched: the error that every further line of G-code repeats; 0 for none.
    """

    axes = "XYZA"
    blocks = 35
    banner = "\r\nGrblHAL 1.1f ['$' or '$HELP' for help]\r\n"
    buffer_size = 1024
    # Its chips have no boot loader that listens, and timers of 32 bits.
    boot_s = 0.2
    slowest_steps_s = 0.0
    # They save and restore the modal state, which nothing here needs.
    extra_words: ClassVar[dict[str, frozenset[float]]] = {"M": frozenset({70.0, 71.0, 72.0, 73.0})}
    latched = 0
    _was_return = False

    def ends_line(self, character: str) -> bool:
        """An LF right behind a CR belongs to it."""
        is_second = character == "\n" and self._was_return
        self._was_return = character == "\r"
        return not is_second

    def on_reset(self) -> None:
        super().on_reset()
        self.latched, self._was_return = 0, False

    def _life(self, *, is_new: bool) -> Generator[float, None, None]:
        self.latched = 0
        yield from super()._life(is_new=is_new)

    def _obey(self, line: str) -> Generator[float, None, int]:
        is_gcode = bool(line) and not line.startswith("$")
        if is_gcode and self.latched:
            return self.latched
        number = yield from super()._obey(line)
        if not is_gcode:
            self.latched = 0
        if number:
            self.latched = number
        return number

    def build_info(self) -> str:
        return "[VER:1.1f.20240212:]\r\n[OPT:VNMSL,35,1024,4,0]\r\n[FIRMWARE:grblHAL]\r\n"

    def report(self) -> str:
        at = f"MPos:{self._place()}"
        queue = f"Bf:{self.planner.room(self.now_s)},{self.buffer_size - len(self.received)}"
        speed = f"FS:{self._speed():.0f},{self.modal.power if self.modal.spindle != 5 else 0.0:.0f}"
        fields = [queue, speed, at, *reversed(self._taken_rare_fields()), "H:0", "TLR:0"]
        return f"<{self._state_name()}|{'|'.join(fields)}>\r\n"


FIRMWARES.register("grblhal", GrblHal)
