"""Grbl 1.1h on an Arduino Uno: table on one axis, lasers on the spindle's PWM and on the coolant pin."""

import math
import re
from collections.abc import Callable, Generator, Iterator
from dataclasses import replace
from enum import StrEnum
from types import MappingProxyType
from typing import ClassVar

from app.simulation.firmware.gcode import GcodeError, Line, Modal, understand
from app.simulation.firmware.grbl_settings import GrblSettings, SettingError
from app.simulation.firmware.kernel import FIRMWARES, Firmware
from app.simulation.firmware.planner import PREPARED_S, Block, Planner
from app.simulation.firmware.plant import Plant

SPINDLE, COOLANT = 0, 1
# The least the 16-bit step timer can do.
_SLOWEST_STEPS_S = 30.5
_LINE_LENGTH = 80
_ALARM_S, _FORMAT_S = 0.5, 0.34
_SETTING = re.compile(r"(\d+)=(.*)")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)")
_RESET, _JOG_CANCEL, _FLOOD_TOGGLE = 0x18, 0x85, 0xA0


class State(StrEnum):
    """What the board is doing, in the words of its status report."""

    IDLE = "Idle"
    RUN = "Run"
    HOLD = "Hold"
    JOG = "Jog"
    ALARM = "Alarm"
    SLEEP = "Sleep"


class _Reset(Exception):  # noqa: N818 (an event, not an error)
    """The main loop is left for a new start."""


class Grbl(Firmware):
    """Grbl: an `ok` means queued, some bytes act at once, settings wear an EEPROM.

    Attributes:
        state: what it is doing.
        settings: the numbers behind `$`; they survive a reset.
        pwm: duty of the spindle's pin, 0..255.
        planner: the queue of moves.
    """

    driver = "grbl"
    driver_options = MappingProxyType[str, object](
        {"steps_per_deg": 80.0 / 9.0, "speed_deg_s": 90.0, "acceleration_deg_s2": 180.0}
    )
    axes = "XYZ"
    blocks = 15
    banner = "\r\nGrbl 1.1h ['$' for help]\r\n"
    slowest_steps_s = _SLOWEST_STEPS_S
    extra_words: ClassVar[dict[str, frozenset[float]]] = {}

    def __init__(self, plant: Plant, *, table_axis: str = "X", is_blank: bool = False) -> None:
        super().__init__(plant)
        self.settings = GrblSettings(len(self.axes), is_blank)
        self.planner = Planner(plant, self.axes.index(table_axis), len(self.axes), self.blocks)
        self.state, self.pwm = State.IDLE, 0
        self.modal = Modal()
        self._offset = [0.0] * len(self.axes)
        self._alarm: int | None = None
        self._is_reset_due = self._wants_report = self._wants_hold = self._wants_start = False
        self._is_jog_cancelled = self._wants_flood_toggle = False
        self._cycle_end_s = math.inf
        self._held_back: list[int] = []
        self._writing_until_s = -math.inf
        self._until_offset = self._until_override = 0

    # What interrupts and wires do.

    def on_byte(self, byte: int) -> bool:
        if self.now_s < self._writing_until_s:
            # The port keeps two bytes while interrupts are off.
            if len(self._held_back) < 2:
                self._held_back.append(byte)
            else:
                self.lost_bytes += 1
            return True
        return self._take_at_once(byte)

    def on_reset(self) -> None:
        self._stop_pulses()
        self.planner.forget()
        self._switch_off()
        self.plant.hold(True, self.now_s)
        self._held_back.clear()
        self._writing_until_s, self._alarm = -math.inf, None
        self.state = State.ALARM if self.settings[22] else State.IDLE

    def trip_limit(self, time_s: float) -> None:
        """The limit switch of an axis closes."""
        self.advance(time_s)
        if self.settings[21] and self._alarm is None:
            self._interrupt_everything(alarm=1)

    def _take_at_once(self, byte: int) -> bool:
        if byte == _RESET:
            is_driven = self.state in (State.RUN, State.JOG) or self._is_braking
            self._interrupt_everything(alarm=3 if is_driven else None)
        elif byte == ord("?"):
            self._wants_report = True
        elif byte == ord("!"):
            self._wants_hold = True
        elif byte == ord("~"):
            self._wants_start = True
        elif byte == _JOG_CANCEL:
            self._is_jog_cancelled = True
        elif byte == _FLOOD_TOGGLE:
            self._wants_flood_toggle = True
        return byte in (_RESET, *b"?!~") or byte > 0x7F

    def _interrupt_everything(self, alarm: int | None) -> None:
        if self._is_reset_due:
            return
        self._is_reset_due = True
        self._alarm = self._alarm or alarm
        self._stop_pulses()
        self._switch_off()

    def _stop_pulses(self) -> None:
        self.planner.cut(self.now_s)
        self._cycle_end_s = math.inf

    def _switch_off(self) -> None:
        self.pwm = 0
        self.plant.switch(SPINDLE, False, self.now_s)
        self.plant.switch(COOLANT, False, self.now_s)

    # The main loop.

    def program(self) -> Iterator[float]:
        is_new, self.settings.is_blank = self.settings.is_blank, False
        if is_new:
            self.say("error:7\r\n")
            yield from self._write_eeprom(_FORMAT_S)
            self.say(self.settings.listing())
        while True:
            try:
                yield from self._life(is_new=is_new)
            except _Reset:
                yield from self._after_reset()
            is_new = False

    def _life(self, *, is_new: bool) -> Generator[float, None, None]:
        self.received.clear()
        self.modal, self._offset = Modal(), [0.0] * len(self.axes)
        self._until_offset = self._until_override = 0
        self._is_reset_due = self._wants_report = self._wants_hold = self._wants_start = False
        self._is_jog_cancelled = self._wants_flood_toggle = False
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
            self._is_reset_due = False
            while not self._is_reset_due:
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

    def _write_eeprom(self, duration_s: float) -> Generator[float, None, None]:
        """Nothing else goes on; of what arrives meanwhile the port keeps two bytes."""
        yield from self.sleep(0.0003)
        self._writing_until_s = self.now_s + duration_s - 0.0003
        yield from self.sleep(duration_s - 0.0003)
        kept, self._held_back = self._held_back, []
        for byte in kept:
            if not self._take_at_once(byte):
                self.received.append(byte)

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

    def _light(self) -> None:
        """The pins as the modal state has them; in laser mode the beam is on only in G1."""
        most = max(self.settings[30], 1.0)
        is_on = self.modal.spindle != 5 and self.modal.power > 0.0
        if self.settings[32] and is_on:
            is_on = self.modal.motion == 1 and (self.modal.spindle == 3 or self.state is State.RUN)
        self.pwm = round(255.0 * min(1.0, self.modal.power / most)) if is_on else 0
        self.plant.switch(SPINDLE, self.pwm > 0, self.now_s)
        self.plant.switch(COOLANT, self.modal.has_coolant, self.now_s)

    def _set_offset(self, line: Line) -> None:
        at = self._units(self.planner.target)
        for axis, letter in enumerate(self.axes):
            if line.once == 92.1:
                self._offset[axis] = 0.0
            elif letter in line.values:
                self._offset[axis] = at[axis] - line.values[letter] * self._scale(line)
        self._until_offset = 0

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

    # Waiting, with what happens meanwhile.

    def _attend(self) -> Generator[float, None, None]:
        """What the main loop looks after between all it does; on hold and asleep it does nothing else."""
        while True:
            if self._is_reset_due:
                raise _Reset
            if self.planner.end_s <= self.now_s < self._cycle_end_s < math.inf:
                # The last pulse's interrupt waits until the driver may be let go.
                yield self._cycle_end_s
                continue
            self._end_cycle()
            self._react()
            if self.state not in (State.HOLD, State.SLEEP):
                return
            yield self._next_s()

    def _wait(self, is_so: Callable[[], bool]) -> Generator[float, None, None]:
        while not is_so():
            self._start_waiting()
            yield self._next_s()
            yield from self._attend()

    def _pause(self, duration_s: float) -> Generator[float, None, None]:
        until = self.now_s + duration_s
        while self.now_s < until:
            yield min(until, self._next_s())
            yield from self._attend()

    def _next_s(self) -> float:
        return min(self._cycle_end_s, self.planner.next_end_s(self.now_s))

    @property
    def _is_standing(self) -> bool:
        return self.state not in (State.RUN, State.JOG) and not self.planner.is_waiting()

    @property
    def _is_braking(self) -> bool:
        return self.state is State.HOLD and self._cycle_end_s < math.inf

    def _start_waiting(self) -> None:
        if self.state is State.IDLE and self.planner.is_waiting():
            self._start_cycle(State.RUN)

    def _start_cycle(self, state: State) -> None:
        self.state = state
        self.plant.hold(True, self.now_s)
        self.planner.start(self.now_s)
        self._note_end()
        self._light()

    def _note_end(self) -> None:
        """Pulses lead the ideal ramp by half a step, which is long at its slow end."""
        idle_s = 0.0 if self.settings[1] == 255 else self.settings[1] / 1000.0
        self._cycle_end_s = self.planner.end_s + max(0.0, idle_s - 0.017)

    def _end_cycle(self) -> None:
        if self.now_s < self._cycle_end_s:
            return
        self._cycle_end_s = math.inf
        if self.settings[1] != 255:
            self.plant.hold(False, self.now_s)
        if self.state is State.JOG and self._is_jog_cancelled:
            self.planner.cut(self.now_s)
        if self.state in (State.RUN, State.JOG):
            self.state, self._is_jog_cancelled = State.IDLE, False
            self._light()

    def _react(self) -> None:
        """To the bytes that act at once, in Grbl's order."""
        if self._wants_report:
            self._wants_report = False
            self.say(self.report())
        if self._wants_hold or self._is_jog_cancelled:
            is_hold, self._wants_hold = self._wants_hold, False
            if self.state is State.JOG:
                self._is_jog_cancelled = True
                self.planner.hold(self.now_s)
                self._note_end()
            elif is_hold and self.state in (State.IDLE, State.RUN):
                self._hold()
            if self.state is not State.JOG:
                self._is_jog_cancelled = False
        if self._wants_start:
            self._wants_start = False
            if self.state is State.HOLD and not self._is_braking:
                self.state = State.IDLE
                self._start_waiting()
        if self._wants_flood_toggle:
            self._wants_flood_toggle = False
            if self.state in (State.IDLE, State.RUN, State.HOLD):
                self.modal = replace(self.modal, has_coolant=not self.modal.has_coolant)
                self._light()

    def _hold(self) -> None:
        if self.state is State.RUN:
            self.planner.hold(self.now_s)
            self._note_end()
        self.state = State.HOLD

    # What it reports.

    def report(self) -> str:
        """The answer to `?`."""
        fields = [self._state_name(), f"{'MPos' if int(self.settings[10]) & 1 else 'WPos'}:{self._place()}"]
        if int(self.settings[10]) & 2:
            fields.append(f"Bf:{self.planner.room(self.now_s)},{self.buffer_size - len(self.received)}")
        fields.append(f"FS:{self._speed():.0f},{self.modal.power if self.modal.spindle != 5 else 0.0:.0f}")
        fields += self._rare_fields()
        return f"<{'|'.join(fields)}>\r\n"

    def _rare_fields(self) -> list[str]:
        """Offsets and overrides come only in some reports."""
        is_busy = self.state in (State.RUN, State.HOLD, State.JOG)
        fields = []
        if self._until_offset > 0:
            self._until_offset -= 1
        else:
            self._until_offset = 29 if is_busy else 9
            self._until_override = self._until_override or 1
            fields.append("WCO:" + ",".join(f"{value:.3f}" for value in self._offset))
        if self._until_override > 0:
            self._until_override -= 1
        else:
            self._until_override = 19 if is_busy else 9
            fields.append("Ov:100,100,100")
            accessories = ("S" if self.modal.spindle == 3 else "") + ("F" if self.modal.has_coolant else "")
            fields += [f"A:{accessories}"] if accessories else []
        return fields

    def _state_name(self) -> str:
        return f"Hold:{int(self._is_braking)}" if self.state is State.HOLD else self.state.value

    def _speed(self) -> float:
        """Of the segment that was computed last, units/min."""
        return 60.0 * self.planner.speed(self.now_s + PREPARED_S)

    def _place(self) -> str:
        at = self._units(self.planner.position(self.now_s))
        if not int(self.settings[10]) & 1:
            at = [value - offset for value, offset in zip(at, self._offset, strict=True)]
        scale = 25.4 if self.settings[13] else 1.0
        return ",".join(f"{value / scale:.3f}" for value in at)

    def _units(self, steps: tuple[int, ...]) -> list[float]:
        return [count / self.settings[100 + axis] for axis, count in enumerate(steps)]

    def _scale(self, line: Line) -> float:
        return 25.4 if line.modal.is_inches else 1.0


FIRMWARES.register("grbl", Grbl)
