"""The Horus look-alike on Sardauscan boards: the same banner, whole degrees, and no word when at a loss."""

import math
import re
from collections.abc import Generator, Iterator

from app.simulation.firmware.kernel import FIRMWARES, Firmware
from app.simulation.firmware.motion import Motion, ramped_move
from app.simulation.firmware.plant import Plant

_POSITIONS_PER_TURN = 512
_STEPS_PER_POSITION = 4
# Steps/s and steps/s²; F is not looked at.
_SPEED, _ACCELERATION = 500.0, 200.0
_BANNER = "\r\nHorus 0.2 ['$' for help]\r\n"
# Its answer to `$`, which it copies from the board that it imitates.
_HELP = (
    "$$ (view settings)",
    "$# (view # parameters)",
    "$G (view parser state)",
    "$I (view build info)",
    "$N (view startup blocks)",
    "$x=value (save setting)",
    "$Nx=line (save startup block)",
    "$C (check gcode mode)",
    "$X (kill alarm lock)",
    "~ (cycle start)",
    "! (feed hold)",
    "? (current status)",
    "ctrl-x (reset)",
)
_LASERS = {"1": 0, "2": 1}
_NUMBER = re.compile(r"\s*([+-]?\d+)")


class HorusClone(Firmware):
    """Reads one line after the other, and nothing while it turns; `\\x18` keeps lasers and place."""

    driver = "horus"
    buffer_size = 64
    steps_per_turn = float(_POSITIONS_PER_TURN * _STEPS_PER_POSITION)

    def __init__(self, plant: Plant) -> None:
        super().__init__(plant)
        self._position = 0
        self._motion: Motion | None = None

    def on_reset(self) -> None:
        if self._motion is not None:
            self.plant.replan(self._motion.braked(self.now_s, math.inf))
        self._motion, self._position = None, 0
        self.plant.hold(False, self.now_s)
        for output in _LASERS.values():
            self.plant.switch(output, False, self.now_s)

    def program(self) -> Iterator[float]:
        self.say(_BANNER)
        line = ""
        while True:
            character = chr((yield from self.read_byte()))
            if character == "\x18":
                self.say(_BANNER)
                line = ""
            elif character in "\r\n":
                yield from self._execute(line)
                line = ""
            else:
                line += character

    def _execute(self, line: str) -> Generator[float, None, None]:
        if line == "$":
            self.say("".join(f"{text}\r\n" for text in _HELP))
        elif line.startswith("G50"):
            self._position = 0
        elif line.startswith(("M17", "M18")):
            self.plant.hold(line.startswith("M17"), self.now_s)
        elif line.startswith(("M70T", "M71T")):
            if line[4:5] in _LASERS:
                self.plant.switch(_LASERS[line[4]], line[2] == "1", self.now_s)
        elif line.startswith("G1X"):
            yield from self._turn_to(_whole(line[3:]))
        elif not line.startswith(("M0", "M2", "M50", "G1", "$1")):
            return
        self.say("ok\r\n")

    def _turn_to(self, angle_deg: int) -> Generator[float, None, None]:
        # C divides towards zero; the product is a 16-bit number.
        positions = int(angle_deg * _POSITIONS_PER_TURN / 360)
        target = _wrapped(_wrapped(positions) * _STEPS_PER_POSITION)
        steps = target - self._position
        if steps == 0:
            return
        self.plant.hold(True, self.now_s)
        self._motion = ramped_move(self.now_s, self._position, steps, _SPEED, _ACCELERATION)
        self.plant.move(self._motion)
        yield from self.sleep(self._motion.end_s - self.now_s)
        self._position, self._motion = target, None


def _whole(text: str) -> int:
    """What C makes of text: the whole number it begins with, of 16 bits, or 0."""
    found = _NUMBER.match(text)
    return _wrapped(int(found[1])) if found else 0


def _wrapped(number: int) -> int:
    return (number + 0x8000) % 0x10000 - 0x8000


FIRMWARES.register("horus_clone", HorusClone)
