"""Boards with Grbl 1.1 or grblHAL: a rotary table on an axis, lasers on the spindle and coolant outputs."""

import contextlib
import math
import threading
import time
from collections.abc import Callable
from typing import TypeVar

from app.devices.grbl_dialogue import (
    ANSWER_S,
    BoardAlarmed,
    BoardLocked,
    BoardRestarted,
    GrblDialogue,
    GrblStatus,
    lost_in_resets,
)
from app.devices.overtaking import alone
from app.devices.ramp import ramped_s
from app.devices.serial_link import SerialLink
from app.devices.turntable import TURNTABLES, Farewell, SteadyTurn, TurntableFacts
from app.errors import (
    DeviceError,
    DeviceRefused,
    DeviceUnrecognised,
    MoveStopped,
    OptionError,
    PositionUnknown,
)

T = TypeVar("T")

_AXES = "XYZA"
# Grbl's step timer has 16 bits; grblHAL's chips have better ones.
_SLOWEST_STEPS_S = 30.5
_TRIES = 4
_LOOK_S = 0.05
_BUSY_WAIT_S = 120.0
_MOTION, _HOLD, _LASER_MODE = 0, 1, 32
_STEPS, _SPEED, _ACCELERATION = 100, 110, 120
_HOLD_FOR_EVER = 255.0
# Three decimals are shown.
_SAME = 0.0006


class GrblTable:
    """Grbl 1.1 (Arduino) and grblHAL.

    Laser 1 is on the spindle's PWM output (`M3`, `M5`), laser 2 on the flood coolant's (`M8`, `M9`).

    Attributes:
        port: where the board is connected.
        name: what messages call it.
        baud: its rate.
        axis: letter of the axis that turns the table: X, Y, Z, or A on grblHAL.
        steps_per_deg: pulses for one degree of the table; written to the board where it has another number.
            0 leaves the board's.
        speed_deg_s: of moves; 0 for the fastest that the board is set to. Where the board's own limit is
            lower, it is raised.
        acceleration_deg_s2: of moves, written to the board where it has another; 0 leaves the board's.
        laser_power: of laser 1, the number after `S`; 1000 is full power on a board with usual settings.
    """

    def __init__(
        self,
        port: str,
        name: str = "turntable",
        *,
        baud: int = 115200,
        axis: str = "X",
        steps_per_deg: float = 0.0,
        speed_deg_s: float = 0.0,
        acceleration_deg_s2: float = 0.0,
        laser_power: float = 1000.0,
    ) -> None:
        if axis.upper() not in _AXES or len(axis) != 1:
            raise OptionError(f"The axis of a Grbl table cannot be {axis!r}.", "Choose X, Y, Z or A.")
        for option, value in (
            ("steps_per_deg", steps_per_deg),
            ("speed_deg_s", speed_deg_s),
            ("acceleration_deg_s2", acceleration_deg_s2),
            ("laser_power", laser_power),
        ):
            if not math.isfinite(value) or value < 0.0:
                raise OptionError(
                    f"The option {option} of a Grbl table cannot be {value}.", "Give 0 or more."
                )
        self.port, self.name, self.baud = port, name, baud
        self._axis = _AXES.index(axis.upper())
        self._asked = {_STEPS: steps_per_deg, _ACCELERATION: acceleration_deg_s2}
        self._asked_speed, self._power = speed_deg_s, laser_power
        self._halted = threading.Event()
        self._link = SerialLink(port, baud, name, on_lost=self._halted.set)
        self._board = GrblDialogue(self._link)
        self._per_deg, self._fastest, self._acceleration = 1.0, 1.0, 1.0
        self._origin_deg, self._steps, self._is_known = 0.0, 0, False
        self._underway: tuple[float, float] | None = None
        self._turn: SteadyTurn | None = None
        self._lit: set[int] = set()
        self._is_asleep = self._has_current = False

    @property
    def facts(self) -> TurntableFacts:
        return TurntableFacts(
            self._board.firmware,
            self.port,
            (1, 2),
            1.0 / self._per_deg,
            slowest_deg_s=self._slowest_deg_s,
            fastest_deg_s=self._fastest,
            tells_position=True,
        )

    @property
    def angle_deg(self) -> float:
        return self._origin_deg + self._steps / self._per_deg

    @property
    def farewell(self) -> Farewell | None:
        # The brakes first, so that the table stands when the reset puts the lasers out; then motor off.
        return Farewell(self.port, self.baud, ((b"!", 0.4), (b"\x18", 1.0), (b"$SLP\n", 0.1)))

    @property
    def is_connected(self) -> bool:
        return self._link.is_open

    def connect(self) -> None:
        if self._link.is_open:
            with self._link.dialogue(wait_s=_BUSY_WAIT_S):
                self._do(self._find_out)
            return
        self._link.close()
        self._link.open()
        self._turn, self._is_asleep, self._has_current = None, False, False
        self._halted.clear()
        try:
            with self._link.dialogue():
                was_reset = self._board.greet()
                self._lit.clear()
                self._come_up(was_reset=was_reset)
        except PositionUnknown:
            raise
        except DeviceError:
            self._link.close()
            raise

    def disconnect(self) -> None:
        if self._link.is_open:
            with contextlib.suppress(DeviceError):
                self.make_safe()
        self._link.close()

    def move_to(self, angle_deg: float) -> float:
        with self._link.dialogue(wait_s=_BUSY_WAIT_S):
            self._do(lambda: self._move(angle_deg))
            return self.angle_deg

    def start_turning(self, angle_deg: float, speed_deg_s: float) -> SteadyTurn:
        slowest = max(self._slowest_deg_s, 1e-3)
        if not slowest <= speed_deg_s <= self._fastest * 1.0001:
            raise DeviceRefused(
                self.name,
                f"cannot turn at {speed_deg_s:g} degrees per second",
                f"Choose a speed from {slowest:.3g} to {self._fastest:.3g} degrees per second.",
            )
        with self._link.dialogue(wait_s=_BUSY_WAIT_S):
            return self._do(lambda: self._start(angle_deg, min(speed_deg_s, self._fastest)))

    def finish_turning(self) -> float:
        turn = self._turn
        while turn is not None and not self._halted.wait(_LOOK_S):
            with self._link.dialogue(wait_s=_BUSY_WAIT_S):
                if self._turn is not turn or not self._do(self._look).is_moving:
                    break
        with self._link.dialogue(wait_s=_BUSY_WAIT_S):
            if turn is not None and self._turn is not turn:
                raise MoveStopped(self.name, "the steady turn was stopped")
            self._do(self._end_turn)
            return self.angle_deg

    def position_now(self) -> float | None:
        with self._link.dialogue(wait_s=_BUSY_WAIT_S):
            status = self._do(self._look)
            return self._origin_deg + status.machine[self._axis]

    @alone
    def stop(self) -> float:
        self._link.interrupt()
        if self._underway is not None:
            self._link.write(b"!")
        with self._link.dialogue(wait_s=_BUSY_WAIT_S):
            if self._underway is None and not self._is_asleep:
                self._do(self._find_out)
            elif self._underway is not None:
                self._do_awake(self._halt)
            return self.angle_deg

    def zero(self, angle_deg: float = 0.0) -> None:
        self._origin_deg += angle_deg - self.angle_deg
        self._underway = None

    def set_laser(self, channel: int, is_on: bool) -> None:
        if channel not in (1, 2):
            raise DeviceRefused(self.name, f"has no laser {channel}", "Its lasers are 1 (M3) and 2 (M8).")
        # In mid-turn the board switches only when the table stands.
        left_s = 0.0 if self._turn is None else self._turn.duration_s
        with self._link.dialogue(wait_s=_BUSY_WAIT_S):
            self._do(lambda: self._switch(channel, is_on, ANSWER_S + 1.2 * left_s))

    def hold(self, is_holding: bool) -> None:
        """Letting the table go sends the board to sleep, which puts the lasers out too."""
        with self._link.dialogue(wait_s=_BUSY_WAIT_S):
            if is_holding:
                self._do(self._energise)
            elif not self._is_asleep:
                self._do(self._sleep)

    @alone
    def make_safe(self) -> None:
        if not self._link.is_open:
            return
        self._link.interrupt()
        try:
            if self._underway is not None:
                self._link.write(b"!")
            with self._link.dialogue(wait_s=ANSWER_S):
                if self._is_asleep:
                    self._do_awake(self._look)
                if not self._is_asleep:
                    self._do_awake(self._halt)
                    self._do_awake(self._sleep)
        except DeviceError:
            # Whatever the board is at: this puts the lasers out and stops the motor.
            with contextlib.suppress(DeviceError):
                self._link.write(b"\x18")
            raise
        finally:
            self._lit.clear()

    def talk(self, line: str) -> str:
        with self._link.dialogue(wait_s=_BUSY_WAIT_S):
            return self._do(lambda: self._say(line.strip()))

    # What goes on inside a dialogue.

    def _do(self, action: Callable[[], T]) -> T:
        """As `_do_awake`, with a board that is brought to its feet first."""

        def awake() -> T:
            if self._is_asleep:
                self._energise()
            if not self._board.is_in_step:
                self._find_out()
            return action()

        return self._do_awake(awake)

    def _do_awake(self, action: Callable[[], T]) -> T:
        """Do something, again where the board has begun anew or was locked.

        Raises:
            PositionUnknown: it was turning when it began anew.
            DeviceError: an alarm stopped the table.
        """
        for _ in range(_TRIES):
            try:
                return action()
            except BoardRestarted:
                with contextlib.suppress(BoardRestarted):
                    self._begin_anew()
            except BoardAlarmed as alarm:
                self._recover(alarm.number)
            except BoardLocked:
                self._board.unlock()
        raise lost_in_resets(self.name)

    def _come_up(self, *, was_reset: bool) -> None:
        """A board that was just connected: on its feet, set up, lasers off, position found."""
        for _ in range(_TRIES):
            try:
                self._set_up(self._settle())
                self._make_ready()
                status = self._board.status()
                break
            except BoardRestarted:
                was_reset = True
            except BoardAlarmed:
                self._board.reset_after_alarm()
            except BoardLocked:
                self._board.unlock()
        else:
            raise lost_in_resets(self.name)
        if self._is_known and not was_reset:
            self._take(status)
            self._underway = None
            return
        self._rebase(status)
        if self._underway is not None:
            raise self._lost_position()

    def _settle(self) -> GrblStatus:
        """Wait for the end of a move; leave hold, sleep and alarm."""
        ends_s = time.monotonic() + _BUSY_WAIT_S
        while (status := self._board.status()).is_moving and time.monotonic() < ends_s:
            time.sleep(_LOOK_S)
        if status.state != "Idle":
            if status.state != "Alarm":
                self._board.reset()
            self._board.unlock()
            status = self._board.status()
        self._is_asleep = False
        self._board.get_in_step()
        return status

    def _set_up(self, status: GrblStatus) -> None:
        """Learn the board's settings; write those that have to be others, which wears its EEPROM.

        Raises:
            DeviceRefused: the board has no such axis, or cannot turn so slowly.
        """
        if len(status.machine) <= self._axis:
            raise DeviceRefused(self.name, f"has no axis {_AXES[self._axis]}", "Set `axis` to one it has.")
        known = self._board.settings()
        if _STEPS + self._axis not in known:
            raise DeviceUnrecognised(self.name, "does not tell its settings")
        self._has_current = self._has_current or known.get(_HOLD) == _HOLD_FOR_EVER
        wanted = {_HOLD: _HOLD_FOR_EVER, _LASER_MODE: 0.0}
        wanted |= {first + self._axis: value for first, value in self._asked.items() if value > 0.0}
        if 60.0 * self._asked_speed > known[_SPEED + self._axis] + _SAME:
            wanted[_SPEED + self._axis] = 60.0 * self._asked_speed
        for number, value in wanted.items():
            if number in known and abs(known[number] - value) > _SAME:
                self._board.request(f"${number}={_number(value)}")
            # The board shows three decimals of what it was told.
            known[number] = value
        self._board.units_per_inch = 25.4 if known.get(13) else 1.0
        is_new_scale = self._per_deg != known[_STEPS + self._axis]
        self._per_deg = known[_STEPS + self._axis]
        if is_new_scale and self._is_known:
            self._origin_deg, self._steps = self.angle_deg, 0
        self._fastest = known[_SPEED + self._axis] / 60.0
        self._acceleration = known[_ACCELERATION + self._axis]
        if min(self._per_deg, self._fastest, self._acceleration) <= 0.0:
            raise DeviceRefused(self.name, "has a scale, speed or acceleration of zero", "Set $100 to $122.")
        if 0.0 < self._asked_speed < self._slowest_deg_s:
            raise DeviceRefused(
                self.name,
                f"cannot turn at {self._asked_speed:g} degrees per second",
                f"Set `speed_deg_s` to {self._slowest_deg_s:.3g} or more.",
            )

    @property
    def _slowest_deg_s(self) -> float:
        return 0.0 if self._board.firmware.startswith("grblHAL") else _SLOWEST_STEPS_S / self._per_deg

    def _make_ready(self) -> None:
        """What every start of the board forgets, and lasers as they should be."""
        self._board.request(f"G21 G90 G94 F{_number(60.0 * self._speed_deg_s)}")
        for channel in (1, 2):
            self._switch(channel, channel in self._lit)

    @property
    def _speed_deg_s(self) -> float:
        return min(self._asked_speed or self._fastest, self._fastest)

    def _begin_anew(self) -> None:
        """The board has reset itself. Its count begins at what it says; the angle is kept where it stood."""
        self._turn, self._is_asleep, self._has_current = None, False, True
        status = self._settle()
        self._make_ready()
        self._rebase(status)
        if self._underway is not None:
            self._lit.clear()
            raise self._lost_position()

    def _recover(self, number: int) -> None:
        """From an alarm; the board has counted its pulses up to there."""
        was_moving, self._turn = self._underway is not None, None
        self._lit.clear()
        self._board.reset_after_alarm()
        status = self._settle()
        self._make_ready()
        self._take(status)
        self._underway = None
        if was_moving:
            why = {1: "a limit switch closed", 2: "the angle is beyond the travel that is set"}
            raise DeviceError(
                self.name,
                f"stopped at {self.angle_deg:.2f} degrees with alarm {number} ({why.get(number, 'reset')})",
                "A turntable needs no limits: set $20=0 and $21=0 on the board.",
            )

    def _find_out(self) -> None:
        """Where it stands, once it does."""
        status = self._board.status()
        if status.state != "Idle":
            status = self._settle()
            self._make_ready()
        self._board.get_in_step()
        self._take(status)
        self._underway, self._turn = None, None

    def _look(self) -> GrblStatus:
        status = self._board.status()
        self._is_asleep = status.state == "Sleep"
        if status.state == "Alarm":
            raise BoardLocked
        return status

    def _take(self, status: GrblStatus) -> None:
        self._steps = round(status.machine[self._axis] * self._per_deg)

    def _rebase(self, status: GrblStatus) -> None:
        """The board's count has begun anew while the table kept its angle."""
        angle = self.angle_deg if self._is_known else 0.0
        self._take(status)
        self._origin_deg, self._is_known = angle - self._steps / self._per_deg, True

    def _lost_position(self) -> PositionUnknown:
        ends, self._underway = self._underway or (self.angle_deg, self.angle_deg), None
        return PositionUnknown(self.name, *sorted(ends))

    def _move(self, angle_deg: float) -> None:
        if self._turn is not None:
            self._end_turn()
        if self._underway is not None:
            self._find_out()
        ramp_s = self._send_move(angle_deg, self._speed_deg_s)
        if ramp_s > 0.0:
            self._wait_for_stand(ramp_s)

    def _send_move(self, angle_deg: float, speed_deg_s: float) -> float:
        """Queue a move; how long it will take, seconds."""
        target = round((angle_deg - self._origin_deg) * self._per_deg)
        way = abs(target - self._steps) / self._per_deg
        if way == 0.0:
            return 0.0
        place = f"{_AXES[self._axis]}{_number(target / self._per_deg)}"
        command = f"G90 G53 G1 {place} F{_number(60.0 * speed_deg_s)}"

        def note() -> None:
            self._underway = (self.angle_deg, self._origin_deg + target / self._per_deg)

        try:
            self._board.request(command, on_sent=note)
        except (BoardRestarted, BoardLocked, DeviceRefused):
            # Without its ok the board had not begun.
            self._underway = None
            raise
        self._has_current = True
        return self._duration_s(way, speed_deg_s)

    def _wait_for_stand(self, duration_s: float) -> None:
        """`G4 P0` is answered when the motion is over."""
        self._board.request("G4 P0", ANSWER_S + 1.2 * duration_s)
        self._take(self._board.status())
        self._underway = None

    def _duration_s(self, way_deg: float, speed_deg_s: float) -> float:
        return ramped_s(way_deg, speed_deg_s, self._acceleration)

    def _start(self, angle_deg: float, speed_deg_s: float) -> SteadyTurn:
        if self._turn is not None:
            self._end_turn()
        began = self.angle_deg
        self._halted.clear()
        duration_s = self._send_move(began + angle_deg, speed_deg_s)
        ends = self._underway[1] if self._underway is not None else began
        turn = SteadyTurn(
            from_deg=began,
            to_deg=ends,
            speed_deg_s=math.copysign(speed_deg_s, angle_deg),
            started_s=time.monotonic(),
            steady_after_s=speed_deg_s / self._acceleration,
            duration_s=duration_s,
        )
        self._turn = turn
        return turn

    def _end_turn(self) -> None:
        turn = self._turn
        if turn is not None:
            self._wait_for_stand(turn.duration_s)
        self._turn = None

    def _halt(self) -> None:
        """The clean way to stop: brakes, wait until it stands, reset. The count is exact, lasers go off."""
        self._link.write(b"!")
        ends_s = time.monotonic() + ANSWER_S + self._fastest / self._acceleration
        while (status := self._board.status()).is_moving and time.monotonic() < ends_s:
            time.sleep(_LOOK_S / 5.0)
        self._lit.clear()
        self._turn = None
        if status.state != "Sleep":
            self._board.reset()
            self._take(self._settle())
            self._make_ready()
        self._underway = None
        self._halted.set()

    def _switch(self, channel: int, is_on: bool, timeout_s: float = ANSWER_S) -> None:
        words = {1: (f"M3 S{_number(self._power)}", "M5"), 2: ("M8", "M9")}[channel]
        if is_on:
            # Counted as lit from before the command.
            self._lit.add(channel)
        self._board.request(words[0 if is_on else 1], timeout_s)
        if not is_on:
            self._lit.discard(channel)

    def _energise(self) -> None:
        """Current on: with $1=255 the board's start does it, and it ends its sleep."""
        if self._has_current and not self._is_asleep:
            return
        self._board.reset()
        self._is_asleep, self._has_current = False, True
        self._take(self._settle())
        self._make_ready()

    def _sleep(self) -> None:
        if self._turn is not None:
            self._end_turn()
        self._board.request("$SLP")
        self._is_asleep, self._has_current = True, False
        self._lit.clear()

    def _say(self, line: str) -> str:
        if line in ("?", "!", "~"):
            self._link.discard()
            self._link.write(line.encode())
            return self._link.listen(0.3).decode("ascii", "replace").strip()
        said = self._board.request(line, _BUSY_WAIT_S)
        status = self._settle()
        self._take(status)
        return "\n".join([*said, "ok"])


def _number(value: float) -> str:
    """As Grbl reads it: at most five decimals, no exponent."""
    return f"{value:.5f}".rstrip("0").rstrip(".")


TURNTABLES.register("grbl", GrblTable)
