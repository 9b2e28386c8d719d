"""Grbl 1.1h on an Arduino Uno: table on one axis, lasers on the spindle's PWM and on the coolant pin."""

import math
import re
from collections.abc import Generator, Iterator
from types import MappingProxyType
from typing import ClassVar

from app.simulation.firmware.gcode import GcodeError, Line, Modal, understand
from app.simulation.firmware.grbl_machine import GrblMachine, MachineReset, State
from app.simulation.firmware.grbl_settings import SettingError
from app.simulation.firmware.kernel import FIRMWARES
from app.simulation.firmware.planner import Block

# The least the 16-bit step timer can do.
_SLOWEST_STEPS_S = 30.5
_LINE_LENGTH = 80
_ALARM_S, _FORMAT_S = 0.5, 0.34
_SETTING = re.compile(r"(\d+)=(.*)")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)")


class Grbl(GrblMachine):
    """Grbl: an `ok` means queued, some bytes act at once, settings wear an EEPROM."""

    driver = "grbl"
    driver_options = MappingProxyType[str, object](
        {"steps_per_deg": 80.0 / 9.0, "speed_deg_s": 90.0, "acceleration_deg_s2": 180.0}
    )
    banner = "\r\nGrbl 1.1h ['$' for help]\r\n"
    slowest_steps_s = _SLOWEST_STEPS_S
    extra_words: ClassVar[dict[str, frozenset[float]]] = {}

    def program(self) -> Iterator[float]:
        is_new, self.settings.is_blank = self.settings.is_blank, False
        if is_new:
            self.say("error:7\r\n")
            yield from self._write_eeprom(_FORMAT_S)
            self.say(self.settings.listing())
        while True:
            try:
                yield from self._life(is_new=is_new)
            except MachineReset:
                yield from self._after_reset()
            is_new = False

    def _life(self, *, is_new: bool) -> Generator[float, None, None]:
        self.received.clear()
        self._forget()
        self._switch_off()
        yield from self._let_go()
        yield from self.sleep(0.0002)
        self.say(self.banner)
        if self.state in (State.ALARM, State.SLEEP):
            self.state = State.ALARM
            self.say("[MSG:'$H'|'$X' to unlock]\r\n")
        else:
            self.state = State.IDLE
            self.say(">:error:7\r\n" * 2 if is_new else "")
        while True:
            line = yield from self._read_line()
            yield from self._answer(line)

    def _after_reset(self) -> Generator[float, None, None]:
        alarm, self._alarm = self._alarm, None
        if alarm is None:
            return
        yield from self.sleep(self.settings[1] / 1000.0)
        self.plant.hold(False, self.now_s)
        self.state = State.ALARM
        self.say(f"ALARM:{alarm}\r\n")
        yield from self.sleep(_ALARM_S)
        if alarm == 1:
            self.say("[MSG:Reset to continue]\r\n")
            self._wishes.reset = False
            while not self._wishes.reset:
                yield math.inf

    def _let_go(self) -> Generator[float, None, None]:
        """The driver after a start; 255 keeps it on."""
        if self.settings[1] == 255:
            self.plant.hold(True, self.now_s)
            return
        yield from self.sleep(self.settings[1] / 1000.0)
        self.plant.hold(False, self.now_s)

    def _read_line(self) -> Generator[float, None, str | None]:
        """The next line in capitals, without spaces and comments; None for one that is too long."""
        characters: list[str] = []
        is_comment, is_long = False, False
        while True:
            yield from self._attend()
            if not self.received:
                self._start_waiting()
                yield self._next_s()
                continue
            character = chr(self.received.popleft())
            if character in "\r\n" and self.ends_line(character):
                yield from self._attend()
                return None if is_long else "".join(characters)
            if character in "(;":
                is_comment = True
            elif character == ")":
                is_comment = False
            elif not is_comment and character > " " and character != "/":
                is_long = is_long or len(characters) >= _LINE_LENGTH - 1
                characters.append(character.upper())

    def ends_line(self, character: str) -> bool:
        """Whether this CR or LF ends a line; here each of them does."""
        return True

    def _answer(self, line: str | None) -> Generator[float, None, None]:
        number = 11
        if line is not None:
            number = yield from self._obey(line)
        self.say("ok\r\n" if number == 0 else f"error:{number}\r\n")
        if self.state is State.SLEEP:
            self.say("[MSG:Sleeping]\r\n")
            yield from self._attend()

    def _obey(self, line: str) -> Generator[float, None, int]:
        """Do what a line says; the number of the error, or 0."""
        if not line:
            return 0
        try:
            if line.startswith("$"):
                yield from self._obey_system(line[1:])
                return 0
            if self.state in (State.ALARM, State.JOG):
                return 9
            yield from self._obey_gcode(line)
        except (GcodeError, SettingError) as refused:
            yield from self.sleep(0.0001)
            return refused.number
        return 0

    def _obey_system(self, text: str) -> Generator[float, None, None]:
        is_free = self.state in (State.IDLE, State.ALARM)
        if text == "":
            self.say("[HLP:$$ $# $G $I $N $x=val $Nx=line $J=line $SLP $C $X $H ~ ! ? ctrl-x]\r\n")
        elif text == "$" and self.state is not State.RUN:
            self.say(self.settings.listing())
        elif text == "G":
            self.say(f"[{self.modal.report()}]\r\n")
        elif text == "X":
            if self.state is State.ALARM:
                self.say("[MSG:Caution: Unlocked]\r\n")
                self.state = State.IDLE
        elif text.startswith("J="):
            if self.state not in (State.IDLE, State.JOG):
                raise SettingError(9)
            yield from self._obey_gcode(text[2:], is_jog=True)
        elif not is_free:
            raise SettingError(8)
        elif text == "I":
            yield from self.sleep(0.0005)
            self.say(self.build_info())
        elif text == "H":
            if not self.settings[22]:
                raise SettingError(5)
            self.state = State.IDLE
        elif text == "SLP":
            self._switch_off()
            self.plant.hold(False, self.now_s)
            self.state = State.SLEEP
        else:
            yield from self._obey_setting(text)

    def build_info(self) -> str:
        return "[VER:1.1h.20190825:]\r\n[OPT:V,15,128]\r\n"

    def _obey_setting(self, text: str) -> Generator[float, None, None]:
        found = _SETTING.fullmatch(text)
        if found is None:
            raise SettingError(3)
        if not _NUMBER.fullmatch(found[2]):
            raise SettingError(2)
        duration_s = self.settings.write(int(found[1]), float(found[2]))
        yield from self._write_eeprom(duration_s)

    def _obey_gcode(self, text: str, *, is_jog: bool = False) -> Generator[float, None, None]:
        line = understand(text, self.modal, self.axes, self.extra_words, is_jog=is_jog)
        yield from self.sleep(0.0001)
        if not is_jog:
            yield from self._switch_lasers(line.modal)
            self.modal = line.modal
        if line.once == 4:
            yield from self._wait(lambda: self._is_standing)
            yield from self._pause(line.values["P"])
        elif line.once in (92, 92.1):
            self._set_offset(line)
        elif line.has_axes(self.axes):
            yield from self._move(line, is_jog=is_jog)
        self._light()
        if line.flow is not None:
            yield from self._wait(lambda: self._is_standing)
            if line.flow == 0:
                self.state = State.HOLD
            elif line.flow in (2, 30):
                self.modal = Modal(motion=1, feed=self.modal.feed)
                self._switch_off()
                self.say("[MSG:Pgm End]\r\n")

    def _switch_lasers(self, wanted: Modal) -> Generator[float, None, None]:
        """A laser changes only when the table stands."""
        is_same = (wanted.spindle, wanted.has_coolant) == (self.modal.spindle, self.modal.has_coolant)
        if not is_same or (wanted.spindle != 5 and wanted.power != self.modal.power):
            yield from self._wait(lambda: self._is_standing)
            yield from self.sleep(0.0001)

    def _set_offset(self, line: Line) -> None:
        at = self._units(self.planner.target)
        for axis, letter in enumerate(self.axes):
            if line.once == 92.1:
                self._offset[axis] = 0.0
            elif letter in line.values:
                self._offset[axis] = at[axis] - line.values[letter] * self._scale(line)
        self._rare_fields.tell_offset()

    def _move(self, line: Line, *, is_jog: bool) -> Generator[float, None, None]:
        start = self.planner.target
        target = self._units(start)
        for axis, letter in enumerate(self.axes):
            if letter in line.values:
                value = line.values[letter] * self._scale(line)
                if line.modal.is_relative and line.once != 53:
                    target[axis] += value
                else:
                    target[axis] = value + (0.0 if line.once == 53 else self._offset[axis])
        steps = tuple(round(at * self.settings[100 + axis]) - start[axis] for axis, at in enumerate(target))
        yield from self.sleep(0.0023 if is_jog else 0.0006)
        block = self._block(start, steps, line, is_jog=is_jog)
        if block is None:
            return
        yield from self._wait(lambda: self.planner.room(self.now_s) > 0)
        self.planner.add(block, self.now_s)
        if self.state in (State.RUN, State.JOG):
            self._note_end()
        elif is_jog:
            self._start_cycle(State.JOG)

    def _block(
        self, start: tuple[int, ...], steps: tuple[int, ...], line: Line, *, is_jog: bool
    ) -> Block | None:
        """The way of a line with the speed and acceleration that every axis on it allows."""
        ways = [abs(count) / self.settings[100 + axis] for axis, count in enumerate(steps)]
        length = math.hypot(*ways)
        if length == 0.0:
            return None
        used = [(axis, way / length) for axis, way in enumerate(ways) if way > 0.0]
        fastest = min(self.settings[110 + axis] / part for axis, part in used)
        acceleration = min(self.settings[120 + axis] / part for axis, part in used)
        feed = line.values["F"] * self._scale(line) if is_jog else line.modal.feed
        speed = fastest if line.modal.motion == 0 and not is_jog else min(feed, fastest)
        slowest = self.slowest_steps_s / max(abs(count) for count in steps) * length
        return Block(start, steps, length, max(speed / 60.0, slowest), acceleration)

    def _scale(self, line: Line) -> float:
        return 25.4 if line.modal.is_inches else 1.0


FIRMWARES.register("grbl", Grbl)
