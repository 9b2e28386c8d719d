"""The FabScanPi firmware: echoes every byte, answers with a prompt, and moves while it listens to nothing."""

import math
from collections.abc import Iterator, Mapping
from itertools import pairwise
from types import MappingProxyType

from app.simulation.firmware.kernel import FIRMWARES, Firmware
from app.simulation.firmware.motion import Motion, ramped_move, steady_turn
from app.simulation.firmware.plant import Plant

LEFT, RIGHT = 0, 1
_LINE_SIZE = 64
_FASTEST = 2460.0
_ENDLESS_SPEED = 1000.0
_RAMP = 500.0
_RING_S = 0.1
# What a step costs beyond its interval: the main loop looks at the time every few microseconds.
_LATE_S = 3.5e-6
_CRAWL_S = 1.0
# Levels of (STEP, DIR) at the four counts of the two-wire sequence; STEP is written first.
_SEQUENCE = ((0, 1), (1, 1), (1, 0), (0, 0))
_AFTER_RESET = (0, 0)
_SWITCHES = {19: (LEFT, True), 20: (LEFT, False), 21: (RIGHT, True), 22: (RIGHT, False)}
_HELP = (
    "FabScan G-CODDE Interpreter Version: {version}",
    "Commands:",
    "G00 [T(steps)]; - linear move",
    "G01 [T(steps)] [L(steps)] [F(feedrate)]; - move",
    "M17; - enable motors",
    "M18; - disable motors",
    "M19; - turn left laser on",
    "M20; - turn left laser off",
    "M21; - turn right laser on",
    "M22; - turn right laser off",
    "M100; - this help message",
    "M114; - report position and feedrate",
)


class FabScan(Firmware):
    """Versions differ in baud rate, in what T counts, and in what they tell of themselves.

    Attributes:
        counts_per_step: what T counts of one motor step. Where it is 4, pulses come from a two-wire sequence
            that was never meant for a STEP and a DIR wire.
        ring: red, green and blue of the light ring.
    """

    buffer_size = 64
    steps_per_turn = 3200.0
    outputs = (LEFT, RIGHT)
    channels = (1, 0)
    driver_options: Mapping[str, object] = MappingProxyType({"baud": 14400})

    def __init__(
        self,
        plant: Plant,
        version: str = "v.20210318",
        board: int = 2,
        baud: int = 0,
        counts_per_step: int = 0,
    ) -> None:
        """What is 0 is as that version has it; `board` 0 is one that knows no M201."""
        super().__init__(plant)
        date = _date(version)
        self.version, self.board = version, board if date >= 20180101 else 0
        self.baud = baud or _usual_baud(date, board)
        self.counts_per_step = counts_per_step or usual_counts_per_step(date)
        self.ring = (0, 0, 0)
        self._prompt = ">" if date < 20170101 else ">\r\n"
        self._pins = _AFTER_RESET
        self._count = 0
        self._is_holding = False
        self._motion: Motion | None = None
        self._has_turned_endlessly = False

    def on_reset(self) -> None:
        if self._motion is not None:
            self.plant.replan(self._motion.braked(self.now_s, math.inf))
        self._motion, self._pins, self._count, self._has_turned_endlessly = None, _AFTER_RESET, 0, False
        for output in (LEFT, RIGHT):
            self.plant.switch(output, False, self.now_s)
        self.plant.hold(False, self.now_s)
        self._is_holding, self.ring = False, (0, 0, 0)

    def program(self) -> Iterator[float]:
        # The pin is an output before it is high: the driver is on for an instant.
        self.plant.hold(True, self.now_s)
        self.plant.hold(False, self.now_s)
        line = bytearray()
        while True:
            byte = yield from self.read_byte()
            self.say(bytes([byte]))
            if byte not in b"\r\n":
                line += bytes([byte])[: _LINE_SIZE - 1 - len(line)]
                continue
            yield from self.sleep(2.0 * self.byte_s)
            words = _Words(line.decode("latin-1"))
            line.clear()
            yield from self._obey_g(words)
            yield from self._obey_m(words)
            self.say(self._prompt)

    def _obey_g(self, words: "_Words") -> Iterator[float]:
        code = words.number("G", -1)
        counts, feed = words.number("T", 0), words.number("F", 0)
        if code in (1, 2) and counts:
            self._end_endless()
            if code == 1 and feed <= 0:
                yield from self._hang()
            elif code == 1:
                interval_s = max(1.0 / feed + _LATE_S, 1.0 / _FASTEST)
                yield from self._turn(counts, (abs(counts) - 1) * interval_s)
            elif self._has_turned_endlessly:
                yield from self._crawl(1 if counts > 0 else -1)
            else:
                yield from self._turn(counts, ramp_s(abs(counts)), is_ramped=True)
        elif code == 6:
            self._has_turned_endlessly = True
            speed = _ENDLESS_SPEED / self.counts_per_step
            # The first pulse may go the wrong way, and the turn stays behind by it.
            self._begin(ramped_move(self.now_s, 0.0, self._pulses(self.counts_per_step) - 1, speed, math.inf))
            self._begin(steady_turn(self.now_s, 0.0, speed))
        elif code == 7:
            self._end_endless()

    def _obey_m(self, words: "_Words") -> Iterator[float]:
        code = words.number("M", -1)
        if code in (13, 14, 17, 18):
            self._is_holding = code in (13, 17)
            self.plant.hold(self._is_holding, self.now_s)
        elif code in _SWITCHES:
            self.plant.switch(*_SWITCHES[code], self.now_s)
        elif code in (4, 5):
            if code == 4:
                for output in (LEFT, RIGHT):
                    self.plant.switch(output, False, self.now_s)
            self.ring = (words.number("R", 0), words.number("G", 0), words.number("B", 0))
            yield from self.sleep(_RING_S)
        elif code == 100:
            self.say("".join(f"{text}\r\n" for text in _HELP).format(version=self.version))
        elif code == 200:
            self.say(f"{self.version}\r\n")
        elif code == 201 and self.board:
            self.say(f"{self.board}\r\n")

    def _turn(self, counts: int, duration_s: float, *, is_ramped: bool = False) -> Iterator[float]:
        pulses = self._pulses(counts)
        size, lasts_s = max(abs(pulses), 1), max(duration_s, 1.0 / _FASTEST)
        speed, ramp = size / lasts_s, math.inf
        if is_ramped:
            peak = min(2.0 * speed, _FASTEST / self.counts_per_step)
            speed, ramp = peak, peak / (lasts_s - size / peak)
        self._begin(ramped_move(self.now_s, 0.0, pulses, speed, ramp))
        yield from self.sleep(duration_s)
        self._motion = None

    def _crawl(self, way: int) -> Iterator[float]:
        while True:
            yield from self._turn(way, 0.0)
            self._count += way
            yield from self.sleep(_CRAWL_S)

    def _begin(self, motion: Motion) -> None:
        self._motion = motion
        self.plant.move(motion, is_coupled=self._is_holding)

    def _end_endless(self) -> None:
        if self._motion is not None:
            ended = self._motion.braked(self.now_s, math.inf)
            self.plant.replan(ended)
            self._count += round(ended.steps * self.counts_per_step)
            self._pins = _SEQUENCE[self._count % 4]
        self._motion = None

    def _pulses(self, counts: int) -> int:
        """Where so many counts take the motor.

        Every move counts from where the last endless turn ended; the pins are as the last move left them.
        """
        if self.counts_per_step != 4:
            return int(counts / self.counts_per_step)
        way = 1 if counts > 0 else -1
        # Whole rounds of the sequence are exact; only the first may begin with the wrong levels.
        first = min(abs(counts), 4 + abs(counts) % 4)
        levels = [self._pins] + [_SEQUENCE[(self._count + way * n) % 4] for n in range(1, first + 1)]
        self._pins = levels[-1]
        pulses = sum(
            (1 if direction else -1)
            for (was, direction), (now, _) in pairwise(levels)
            if now and not was
        )  # fmt: skip
        return pulses + way * ((abs(counts) - first) // 4)

    def _hang(self) -> Iterator[float]:
        while True:
            yield math.inf


class _Words:
    """A line as the interpreter reads it: words between spaces, a letter and a 16-bit number."""

    def __init__(self, line: str) -> None:
        self._words = line.split(" ")

    def number(self, letter: str, otherwise: int) -> int:
        for word in self._words:
            if word.startswith(letter):
                return _atoi16(word[1:])
        return otherwise


def ramp_s(counts: int) -> float:
    """From the first to the last count of a move that speeds up by 500 counts/s² and slows down again.

    The step times are those of Austin, "Generate stepper-motor speed profiles in real time" (2005), in which
    a ramp begins with 0.676 of the true first interval.
    """
    interval = first = 0.676 * math.sqrt(2.0 / _RAMP)
    total, ramp_step = 0.0, 1
    for left in range(counts - 1, 0, -1):
        to_stop = int(1.0 / (interval * interval * 2.0 * _RAMP))
        if ramp_step > 0 and to_stop >= left:
            ramp_step = -to_stop
        interval = first if ramp_step == 0 else interval - 2.0 * interval / (4.0 * ramp_step + 1.0)
        ramp_step += 1
        interval = max(interval, 1.0 / _FASTEST)
        total += interval
    return total


def usual_counts_per_step(date: int) -> int:
    """What T counts of a motor step in the version of a date such as 20181101."""
    if date >= 20181101:
        return 4
    return 2 if 20170301 <= date < 20170701 else 1


def _usual_baud(date: int, board: int) -> int:
    if board == 2 and date >= 20190801:
        return 14400
    return 57600 if 20170701 <= date < 20181101 or 20190101 <= date < 20200101 else 115200


def _date(version: str) -> int:
    """The CNC shield of 2019 calls itself `12337`."""
    digits = version.removeprefix("v.")
    return int(digits) if digits.isdigit() and len(digits) == 8 else 20190101


def _atoi16(text: str) -> int:
    sign, digits = (-1, text[1:]) if text.startswith("-") else (1, text)
    end = next((at for at, char in enumerate(digits) if not char.isdigit()), len(digits))
    value = sign * int(digits[:end] or 0)
    return (value + 0x8000) % 0x10000 - 0x8000


FIRMWARES.register("fabscan", FabScan)
