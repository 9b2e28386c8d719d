"""What every Grbl does beneath its language: real-time bytes, motion, pins, and the status report."""

import math
from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from enum import StrEnum

from app.simulation.firmware.gcode import Modal
from app.simulation.firmware.grbl_report import RareFields
from app.simulation.firmware.grbl_settings import GrblSettings
from app.simulation.firmware.kernel import Firmware
from app.simulation.firmware.planner import PREPARED_S, Planner
from app.simulation.firmware.plant import Plant

SPINDLE, COOLANT = 0, 1
_RESET, _JOG_CANCEL, _FLOOD_TOGGLE = 0x18, 0x85, 0xA0


class State(StrEnum):
    """What the board is doing, in the words of its status report."""

    IDLE = "Idle"
    RUN = "Run"
    HOLD = "Hold"
    JOG = "Jog"
    ALARM = "Alarm"
    SLEEP = "Sleep"


class MachineReset(Exception):  # noqa: N818 (an event, not an error)
    """The main loop is left for a new start."""


@dataclass(slots=True)
class Wishes:
    """What real-time bytes asked for, noted by the interrupt for the main loop."""

    reset: bool = False
    report: bool = False
    hold: bool = False
    start: bool = False
    jog_cancel: bool = False
    flood_toggle: bool = False


class GrblMachine(Firmware):
    """A board whose language a subclass speaks.

    Attributes:
        state: what it is doing.
        settings: the numbers behind `$`; they survive a reset.
        pwm: duty of the spindle's pin, 0..255.
        planner: the queue of moves.
        modal: what later lines take over.
    """

    axes = "XYZ"
    blocks = 15

    def __init__(self, plant: Plant, *, table_axis: str = "X", is_blank: bool = False) -> None:
        super().__init__(plant)
        self.settings = GrblSettings(len(self.axes), is_blank)
        self.planner = Planner(plant, self.axes.index(table_axis), len(self.axes), self.blocks)
        self.state, self.pwm = State.IDLE, 0
        self._alarm: int | None = None
        self._cycle_end_s = math.inf
        self._held_back: list[int] = []
        self._writing_until_s = -math.inf
        self._forget()

    def _forget(self) -> None:
        """What every start of the program begins with."""
        self.modal, self._offset = Modal(), [0.0] * len(self.axes)
        self._rare_fields, self._wishes = RareFields(), Wishes()

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
            self._wishes.report = True
        elif byte == ord("!"):
            self._wishes.hold = True
        elif byte == ord("~"):
            self._wishes.start = True
        elif byte == _JOG_CANCEL:
            self._wishes.jog_cancel = True
        elif byte == _FLOOD_TOGGLE:
            self._wishes.flood_toggle = True
        return byte in (_RESET, *b"?!~") or byte > 0x7F

    def _interrupt_everything(self, alarm: int | None) -> None:
        if self._wishes.reset:
            return
        self._wishes.reset = True
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

    def _light(self) -> None:
        """The pins as the modal state has them; in laser mode the beam is on only in G1."""
        most = max(self.settings[30], 1.0)
        is_on = self.modal.spindle != 5 and self.modal.power > 0.0
        if self.settings[32] and is_on:
            is_on = self.modal.motion == 1 and (self.modal.spindle == 3 or self.state is State.RUN)
        self.pwm = round(255.0 * min(1.0, self.modal.power / most)) if is_on else 0
        self.plant.switch(SPINDLE, self.pwm > 0, self.now_s)
        self.plant.switch(COOLANT, self.modal.has_coolant, self.now_s)

    def _write_eeprom(self, duration_s: float) -> Generator[float, None, None]:
        """Nothing else goes on; of what arrives meanwhile the port keeps two bytes."""
        yield from self.sleep(0.0003)
        self._writing_until_s = self.now_s + duration_s - 0.0003
        yield from self.sleep(duration_s - 0.0003)
        kept, self._held_back = self._held_back, []
        for byte in kept:
            if not self._take_at_once(byte):
                self.received.append(byte)

    # Waiting, with what happens meanwhile.

    def _attend(self) -> Generator[float, None, None]:
        """What the main loop looks after between all it does; on hold and asleep it does nothing else."""
        while True:
            if self._wishes.reset:
                raise MachineReset
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
        if self.state is State.JOG and self._wishes.jog_cancel:
            self.planner.cut(self.now_s)
        if self.state in (State.RUN, State.JOG):
            self.state, self._wishes.jog_cancel = State.IDLE, False
            self._light()

    def _react(self) -> None:
        """To the bytes that act at once, in Grbl's order."""
        if self._wishes.report:
            self._wishes.report = False
            self.say(self.report())
        if self._wishes.hold or self._wishes.jog_cancel:
            is_hold, self._wishes.hold = self._wishes.hold, False
            if self.state is State.JOG:
                self._wishes.jog_cancel = True
                self.planner.hold(self.now_s)
                self._note_end()
            elif is_hold and self.state in (State.IDLE, State.RUN):
                self._hold()
            if self.state is not State.JOG:
                self._wishes.jog_cancel = False
        if self._wishes.start:
            self._wishes.start = False
            if self.state is State.HOLD and not self._is_braking:
                self.state = State.IDLE
                self._start_waiting()
        if self._wishes.flood_toggle:
            self._wishes.flood_toggle = False
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
        fields += self._taken_rare_fields()
        return f"<{'|'.join(fields)}>\r\n"

    def _taken_rare_fields(self) -> list[str]:
        is_busy = self.state in (State.RUN, State.HOLD, State.JOG)
        accessories = ("S" if self.modal.spindle == 3 else "") + ("F" if self.modal.has_coolant else "")
        return self._rare_fields.take(self._offset, accessories, is_busy=is_busy)

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
