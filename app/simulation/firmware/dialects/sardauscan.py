"""The Sardauscan's own firmware: words ended by CR, a 28BYJ-48 behind a gear, four lasers.

Sources, read for their figures: Sardau/Sardauscan, FirmWare/FirmWare.ino, configuration.h, SerialCommand.cpp.
"""

import math
import re
from collections.abc import Iterator

from app.simulation.firmware.kernel import FIRMWARES, Firmware
from app.simulation.firmware.motion import Motion, ramped_move
from app.simulation.firmware.plant import Plant

_HALF_STEPS_PER_UNIT = 4
_LASER_PINS = (14, 15, 16, 13)
_LONGEST_LINE = 16
_COMMAND_S = 0.0002


class Sardauscan(Firmware):
    """Version 0.1a. The table turns in units of four half-steps, 1018 to a turn.

    `setup` gives the motor 500 half-steps/s and 200 half-steps/s²: 44 degrees a second at most, a turn in
    10.6 s. Nothing is read during a move; the coils keep their current after the first one.

    Attributes:
        speed, acceleration: of the motor, half-steps/s and half-steps/s².
    """

    buffer_size = 64
    steps_per_turn = 4072.0
    outputs = channels = (0, 1, 2, 3)
    speed, acceleration = 500.0, 200.0

    def __init__(self, plant: Plant) -> None:
        super().__init__(plant)
        self._position = 0
        self._motion: Motion | None = None
        self._lit: set[int] = set()

    def program(self) -> Iterator[float]:
        self._position, self._lit = 0, set()
        self.say("Sardauscan V0.1a\r\n")
        line = ""
        while True:
            byte = yield from self.read_byte()
            if byte == 0x0D:
                yield from self.sleep(_COMMAND_S)
                yield from self._obey(line.split(" "))
                line = ""
            elif 0x20 <= byte < 0x7F:
                # The buffer begins anew when it is full, and the end of a long line is all that is left.
                line = (line if len(line) < _LONGEST_LINE else "") + chr(byte)

    def on_reset(self) -> None:
        if self._motion is not None and self.now_s < self._motion.end_s:
            self.plant.replan(self._motion.braked(self.now_s, math.inf))
        self._motion = None
        for output in range(len(_LASER_PINS)):
            self.plant.switch(output, False, self.now_s)
        self.plant.hold(False, self.now_s)

    def _obey(self, split: list[str]) -> Iterator[float]:
        words = [word for word in split if word]
        if not words:
            return
        if words[0] == "sardauscan":
            self.say("yes\r\n")
        elif words[0] in ("T", "t"):
            yield from self._table(words[1:])
        elif words[0] in ("L", "l"):
            self._laser(words[1:])
        else:
            self.say("Hun?\r\n")

    def _table(self, words: list[str]) -> Iterator[float]:
        if not words:
            self.say(f"Position {self._told_position()}\r\n")
            return
        letter = words[0][0].upper()
        asked = _atoi(words[1]) if len(words) > 1 else 0
        steps = _int16(asked * _HALF_STEPS_PER_UNIT)
        if letter == "R":
            yield from self._turn(steps)
            self.say(f"RELATIVE ROTATION :{asked} => {self._told_position()}\r\n")
        elif letter == "A":
            yield from self._turn(steps - self._position)
            self.say(f"ABSOLUTE ROTATION {asked} => {self._told_position()}\r\n")
        elif letter == "S":
            self.say(f"REVOLUTION STEPS  => {int(self.steps_per_turn) // _HALF_STEPS_PER_UNIT}\r\n")
        elif letter == "C":
            self._position = 0
            self.say("RESET CUTTENT POSITION  => 0\r\n")
        else:
            self.say(f"Unknown Table command :{words[0]}\r\n")

    def _turn(self, steps: int) -> Iterator[float]:
        if steps == 0:
            return
        self.plant.hold(True, self.now_s)
        self._motion = ramped_move(self.now_s, self._position, steps, self.speed, self.acceleration)
        self.plant.move(self._motion)
        yield from self.sleep(self._motion.end_s - self.now_s)
        self._position += steps

    def _told_position(self) -> int:
        return math.trunc(_int16(self._position) / _HALF_STEPS_PER_UNIT)

    def _laser(self, words: list[str]) -> None:
        if not words:
            self.say(f"LASER_COUNT: {len(_LASER_PINS)}\r\n")
            return
        index = _atoi(words[0])
        is_there = 0 <= index < len(_LASER_PINS)
        pin = _LASER_PINS[index] if is_there else -1
        if len(words) == 1:
            self.say(f"LASER_STATE: {index}({pin}) = {int(index in self._lit) if is_there else -1}\r\n")
            return
        if is_there:
            is_on = _atoi(words[1]) == 1
            (self._lit.add if is_on else self._lit.discard)(index)
            self.plant.switch(index, is_on, self.now_s)
        self.say(f"SET_LASER: {index}({pin}) = {int(index in self._lit)}\r\n")


def _atoi(text: str) -> int:
    """What the C library's function makes of a text on a processor with 16-bit integers."""
    match = re.match(r"[+-]?\d+", text)
    return _int16(int(match[0])) if match else 0


def _int16(value: int) -> int:
    return (value + 0x8000) % 0x10000 - 0x8000


FIRMWARES.register("sardauscan", Sardauscan)
