"""Marlin on a RAMPS board: an `ok` means queued, a move is awaited with M400, lasers hang on spare pins."""

import re
from collections.abc import Generator, Iterator, Mapping
from types import MappingProxyType

from app.simulation.firmware import marlin_texts
from app.simulation.firmware.kernel import FIRMWARES, Firmware
from app.simulation.firmware.marlin_motion import AXES, E, MarlinMotion, X
from app.simulation.firmware.plant import Plant

Words = Mapping[str, float]
Answer = Generator[float, None, str]

_LONGEST_LINE = 95
_SETUP_S, _SPLASH_S = 0.224, 5.9
_BUSY_S = 2.0
_COMMAND_S = 1e-4
_PLANNING_S = 1e-3
# With interrupts off the port's own registers keep so many bytes.
_KEPT_WHEN_DEAD = 3
_OK = "ok\n"
_WORD = re.compile(r"([A-Z])(-?\d*\.?\d*)")
_CODE = re.compile(r"([GM])0*(\d+)(?!\S)")
_NUMBERED = re.compile(r"N(\d+) ?(.*)\*(\d+)")


class Marlin(Firmware):
    """Version 1.1.1 with a graphic display, or with another `version` a 2.0 without.

    Attributes:
        motion: coordinates and pulses.
        fans: speed of each fan, 0..255.
    """

    outputs = (0, 1)
    channels = (11, 6)
    driver_options: Mapping[str, object] = MappingProxyType({"lasers": (11, 6)})

    def __init__(
        self,
        plant: Plant,
        version: str = "1.1.1",
        table_axis: str = "X",
        pins: Mapping[int, int] = MappingProxyType({11: 0, 6: 1}),
        fan_lasers: Mapping[int, int] = MappingProxyType({}),
    ) -> None:
        """Lasers are outputs of the plant, by the pin for M42, and by the number of the fan for M106."""
        super().__init__(plant)
        self.version, self.is_old = version, version.startswith("1.")
        self._pins, self._fan_lasers = pins, fan_lasers
        self.motion = MarlinMotion(plant, table_axis, has_slow_timer=self.is_old)
        self.fans: dict[int, int] = {}
        self._last_line = 0
        self._dead_bytes: int | None = None

    def on_byte(self, byte: int) -> bool:
        if self._dead_bytes is None:
            return False
        self._dead_bytes += 1
        self.lost_bytes += self._dead_bytes > _KEPT_WHEN_DEAD
        return True

    def on_reset(self) -> None:
        self.motion.planner.cut(self.now_s)
        self.motion.forget(are_endstops_on=self.is_old)
        for output in (*self._pins.values(), *self._fan_lasers.values()):
            self.plant.switch(output, False, self.now_s)
        self.plant.hold(False, self.now_s)
        self.fans.clear()
        self._last_line, self._dead_bytes = 0, None

    def program(self) -> Iterator[float]:
        self.plant.hold(True, self.now_s)
        self.plant.hold(False, self.now_s)
        yield from self.sleep(_SETUP_S)
        self.say(marlin_texts.start(self.version, is_old=self.is_old) + self._settings())
        if self.is_old:
            yield from self.sleep(_SPLASH_S - _SETUP_S)
        line = bytearray()
        while True:
            byte = yield from self.read_byte()
            if byte not in b"\r\n":
                line += bytes([byte])[: _LONGEST_LINE - len(line)]
                continue
            text = line.decode("latin-1").partition(";")[0].strip(" ")
            line.clear()
            if text:
                yield from self.sleep(_COMMAND_S)
                answer = yield from self._obey(text)
                self.say(answer)

    def _obey(self, text: str) -> Answer:
        if text.startswith("N"):
            numbered = _NUMBERED.match(text)
            is_sound = numbered is not None and _checksum(text.rpartition("*")[0]) == int(numbered[3])
            if numbered is None or not is_sound:
                last = self._last_line
                return f"Error:checksum mismatch, Last Line: {last}\nResend: {last + 1}\n" + _OK
            self._last_line, text = int(numbered[1]), numbered[2]
        code = _CODE.match(text)
        unknown = f'echo:Unknown command: "{text}"\n' + _OK
        if code is None:
            return unknown
        name = f"_{code[1]}{code[2]}".lower()
        if not hasattr(self, name) or (name == "_m42" and not self.is_old):
            # Version 1 says nothing of a number that it does not know.
            return _OK if self.is_old else unknown
        words = {letter: _number(value) for letter, value in _WORD.findall(text[code.end() :])}
        answer: str = yield from getattr(self, name)(words)
        return answer

    def _g0(self, words: Words) -> Answer:
        return self._g1(words)

    def _g1(self, words: Words) -> Answer:
        yield from self.sleep(_PLANNING_S)
        planner = self.motion.planner
        yield from self._wait_until_s(0.0 if planner.room(self.now_s) > 0 else planner.next_end_s(self.now_s))
        self.plant.hold(True, self.now_s)
        return self.motion.move(words, self.now_s)

    def _g4(self, words: Words) -> Answer:
        yield from self._wait_for_moves()
        yield from self._wait_until_s(self.now_s + words.get("S", 0.0) + 1e-3 * words.get("P", 0.0))
        return _OK

    def _g90(self, words: Words) -> Answer:
        yield from ()
        self.motion.is_relative = [False, False]
        return _OK

    def _g91(self, words: Words) -> Answer:
        yield from ()
        self.motion.is_relative = [True, True]
        return _OK

    def _g92(self, words: Words) -> Answer:
        yield from self._wait_for_moves()
        for axis, letter in enumerate(AXES):
            if letter in words:
                self.motion.settle(axis, words[letter], self.now_s)
        return _OK

    def _m17(self, words: Words) -> Answer:
        yield from ()
        self.plant.hold(True, self.now_s)
        return _OK

    def _m18(self, words: Words) -> Answer:
        yield from self._wait_for_moves()
        # With S it only says when motors are let go by themselves.
        if "S" not in words:
            self.plant.hold(False, self.now_s)
        return _OK

    _m84 = _m18

    def _m42(self, words: Words) -> Answer:
        yield from ()
        if int(words.get("P", -1)) in self._pins:
            self.plant.switch(self._pins[int(words["P"])], words.get("S", 0.0) > 0, self.now_s)
        return _OK

    def _m82(self, words: Words) -> Answer:
        yield from ()
        self.motion.is_relative[E] = False
        return _OK

    def _m92(self, words: Words) -> Answer:
        yield from self._wait_for_moves()
        for axis, letter in enumerate(AXES):
            if letter in words:
                self.motion.per_mm[axis] = words[letter]
                self.motion.settle(axis, self.motion.at[axis], self.now_s)
        return _OK

    def _m105(self, words: Words) -> Answer:
        yield from ()
        return "ok T:25 /0 B:25 /0 @:0 B@:0\n"

    def _m106(self, words: Words) -> Answer:
        yield from ()
        self._set_fan(int(words.get("P", 0)), int(words.get("S", 255)))
        return _OK

    def _m107(self, words: Words) -> Answer:
        yield from ()
        self._set_fan(int(words.get("P", 0)), 0)
        return _OK

    def _m112(self, words: Words) -> Answer:
        """Dead until the next reset: interrupts off, motors off, and whatever M42 switched stays."""
        self.motion.planner.cut(self.now_s)
        self.plant.hold(False, self.now_s)
        self.say("Error:Printer halted. kill() called!\n")
        self._dead_bytes = 0
        while True:
            yield float("inf")

    def _m114(self, words: Words) -> Answer:
        yield from self._wait_for_moves()
        x, e = self.motion.at
        count = self.motion.count(X, self.now_s)
        return f"X:{x:.2f} Y:0.00 Z:0.00 E:{e:.2f} Count X:{count} Y:0 Z:0\n" + _OK

    def _m115(self, words: Words) -> Answer:
        yield from ()
        return marlin_texts.who(self.version, is_old=self.is_old) + _OK

    def _m119(self, words: Words) -> Answer:
        yield from ()
        state = "TRIGGERED" if self.is_old else "open"
        switches = "".join(f"{name}_min: {state}\n" for name in "xyz")
        return f"Reporting endstop status\n{switches}" + _OK

    def _m120(self, words: Words) -> Answer:
        yield from ()
        self.motion.are_endstops_on = True
        return _OK

    def _m121(self, words: Words) -> Answer:
        yield from ()
        self.motion.are_endstops_on = False
        return _OK

    def _m203(self, words: Words) -> Answer:
        yield from ()
        for axis, letter in enumerate(AXES):
            self.motion.fastest[axis] = words.get(letter, self.motion.fastest[axis])
        return _OK

    def _m204(self, words: Words) -> Answer:
        yield from ()
        self.motion.acceleration = words.get("T", words.get("P", self.motion.acceleration))
        return _OK

    def _m211(self, words: Words) -> Answer:
        yield from ()
        self.motion.is_bed_limited = words.get("S", 1.0) > 0.0
        return _OK

    def _m302(self, words: Words) -> Answer:
        yield from ()
        self.motion.may_extrude_cold = words.get("P", 0.0) > 0.0 or words.get("S", 1.0) == 0.0
        return _OK

    def _m400(self, words: Words) -> Answer:
        yield from self._wait_for_moves()
        return _OK

    def _m410(self, words: Words) -> Answer:
        yield from ()
        self.motion.stop(self.now_s)
        return _OK

    def _m503(self, words: Words) -> Answer:
        yield from ()
        return self._settings() + _OK

    def _set_fan(self, fan: int, speed: int) -> None:
        self.fans[fan] = speed
        if fan in self._fan_lasers:
            self.plant.switch(self._fan_lasers[fan], speed > 0, self.now_s)

    def _settings(self) -> str:
        return marlin_texts.settings(self.motion.per_mm, self.motion.fastest, self.motion.acceleration)

    def _wait_for_moves(self) -> Iterator[float]:
        yield from self._wait_until_s(self.motion.planner.end_s)

    def _wait_until_s(self, time_s: float) -> Iterator[float]:
        """Wait, and tell the host every two seconds that this is on purpose."""
        tell_s = self.now_s + _BUSY_S
        while self.now_s < time_s:
            yield min(tell_s, time_s)
            if tell_s <= self.now_s < time_s:
                self.say("echo:busy: processing\n")
                tell_s += _BUSY_S


def _checksum(text: str) -> int:
    total = 0
    for byte in text.encode("latin-1"):
        total ^= byte
    return total


def _number(text: str) -> float:
    return float(text) if text.strip("-.") else 0.0


FIRMWARES.register("marlin", Marlin)
