"""Boards with Grbl 1.1 or grblHAL: a rotary table on an axis, lasers on the spindle and coolant outputs."""

import contextlib
import math
import threading
import time

from app.devices.bearings import Bearings
from app.devices.board_driver import BoardDriver
from app.devices.grbl_board import AXES, BUSY_WAIT_S, LASERS, LOOK_S, GrblBoard, number
from app.devices.grbl_dialogue import ANSWER_S, BoardLocked, BoardRestarted
from app.devices.grbl_setup import GrblSetup
from app.devices.overtaking import alone
from app.devices.ramp import ramped_turn
from app.devices.refusals import check_laser, check_speed
from app.devices.serial_link import SerialLink
from app.devices.turntable import TURNTABLES, Farewell, SteadyTurn, TurntableFacts
from app.errors import DeviceError, DeviceRefused, MoveStopped, OptionError, PositionUnknown


class GrblTable(BoardDriver):
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
        if axis.upper() not in AXES or len(axis) != 1:
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
        halted = threading.Event()
        super().__init__(SerialLink(port, baud, name, on_lost=halted.set), Bearings(name))
        self.baud, self._letter = baud, axis.upper()
        setup = GrblSetup(AXES.index(self._letter), steps_per_deg, speed_deg_s, acceleration_deg_s2)
        self._board = GrblBoard(self._link, self._bearings, setup, laser_power, halted)

    @property
    def facts(self) -> TurntableFacts:
        axis = self._board.axis
        return TurntableFacts(
            self._board.dialogue.firmware,
            self.port,
            LASERS,
            1.0 / axis.per_deg,
            slowest_deg_s=axis.slowest_deg_s,
            fastest_deg_s=axis.fastest_deg_s,
            tells_position=True,
        )

    @property
    def farewell(self) -> Farewell | None:
        # The brakes first, so that the table stands when the reset puts the lasers out; then motor off.
        return Farewell(self.port, self.baud, ((b"!", 0.4), (b"\x18", 1.0), (b"$SLP\n", 0.1)))

    def connect(self) -> None:
        if self._link.is_open:
            with self._link.dialogue(wait_s=BUSY_WAIT_S):
                self._board.do(self._board.find_out)
                self._bearings.require_known()
            return
        self._link.close()
        self._link.open()
        self._board.halted.clear()
        try:
            with self._link.dialogue():
                self._board.come_up()
                self._bearings.require_known()
        except PositionUnknown:
            raise
        except DeviceError:
            self._link.close()
            raise

    def move_to(self, angle_deg: float) -> float:
        with self._link.dialogue(wait_s=BUSY_WAIT_S):
            self._board.do(lambda: self._move(angle_deg))
            return self.angle_deg

    def start_turning(self, angle_deg: float, speed_deg_s: float) -> SteadyTurn:
        fastest = self._board.axis.fastest_deg_s
        check_speed(self.name, speed_deg_s, self._board.axis.slowest_deg_s, fastest)
        with self._link.dialogue(wait_s=BUSY_WAIT_S):
            return self._board.do(lambda: self._start(angle_deg, min(abs(speed_deg_s), fastest)))

    def finish_turning(self) -> float:
        turn = self._board.turn
        while turn is not None and not self._board.halted.wait(LOOK_S):
            with self._link.dialogue(wait_s=BUSY_WAIT_S):
                if self._board.turn is not turn or not self._board.do(self._board.look).is_moving:
                    break
        with self._link.dialogue(wait_s=BUSY_WAIT_S):
            if turn is not None and self._board.turn is not turn:
                raise MoveStopped(self.name, "the steady turn was stopped")
            self._board.do(self._end_turn)
            return self.angle_deg

    def position_now(self) -> float | None:
        with self._link.dialogue(wait_s=BUSY_WAIT_S):
            status = self._board.do(self._board.look)
            return self._bearings.origin_deg + status.machine[AXES.index(self._letter)]

    @alone
    def stop(self) -> float:
        self._link.interrupt()
        if self._bearings.way is not None:
            self._link.write(b"!")
        with self._link.dialogue(wait_s=BUSY_WAIT_S):
            if self._bearings.way is not None:
                self._board.do_awake(self._board.halt)
            elif not self._board.is_asleep:
                self._board.do(self._board.find_out)
            self._bearings.require_known()
            return self.angle_deg

    def set_laser(self, channel: int, is_on: bool) -> None:
        check_laser(self.name, channel, LASERS, "Its lasers are 1 (M3) and 2 (M8).")
        # In mid-turn the board switches only when the table stands.
        left_s = 0.0 if self._board.turn is None else self._board.turn.duration_s
        with self._link.dialogue(wait_s=BUSY_WAIT_S):
            self._board.do(lambda: self._board.switch(channel, is_on, 1.2 * left_s))

    def hold(self, is_holding: bool) -> None:
        """Letting the table go sends the board to sleep, which puts the lasers out too."""
        with self._link.dialogue(wait_s=BUSY_WAIT_S):
            if is_holding:
                self._board.do(self._board.energise)
            elif not self._board.is_asleep:
                self._board.do(self._let_go)

    @alone
    def make_safe(self) -> None:
        if not self._link.is_open:
            return
        self._link.interrupt()
        try:
            if self._bearings.way is not None:
                self._link.write(b"!")
            with self._link.dialogue(wait_s=ANSWER_S):
                if self._board.is_asleep:
                    self._board.do_awake(self._board.look)
                if not self._board.is_asleep:
                    self._board.do_awake(self._board.halt)
                    self._board.do_awake(self._board.sleep)
        except DeviceError:
            # Whatever the board is at: this puts the lasers out and stops the motor.
            with contextlib.suppress(DeviceError):
                self._link.write(b"\x18")
            raise
        finally:
            self._board.lit.clear()

    def talk(self, line: str) -> str:
        with self._link.dialogue(wait_s=BUSY_WAIT_S):
            return self._board.do(lambda: self._board.say(line.strip()))

    # What goes on inside a dialogue.

    def _move(self, angle_deg: float) -> None:
        self._get_ready()
        duration_s = self._send_move(angle_deg, self._board.speed_deg_s).duration_s
        if duration_s > 0.0:
            self._wait_for_stand(duration_s)

    def _start(self, angle_deg: float, speed_deg_s: float) -> SteadyTurn:
        self._get_ready()
        self._board.halted.clear()
        self._board.turn = self._send_move(self.angle_deg + angle_deg, speed_deg_s)
        return self._board.turn

    def _get_ready(self) -> None:
        """Nothing under way, and the place known."""
        self._end_turn()
        if self._bearings.way is not None:
            self._board.find_out()
        self._bearings.require_known()

    def _send_move(self, angle_deg: float, speed_deg_s: float) -> SteadyTurn:
        """Queue a move, unless the table is there already; how it will be."""
        target, axis = self._bearings.nearest(angle_deg), self._board.axis
        ends = (self.angle_deg, self._bearings.degrees(target))
        if target != self._bearings.at:
            place = f"{self._letter}{number(target / axis.per_deg)}"
            command = f"G90 G53 G1 {place} F{number(60.0 * speed_deg_s)}"
            try:
                self._board.dialogue.request(command, on_sent=lambda: self._bearings.set_out(target))
            except (BoardRestarted, BoardLocked, DeviceRefused):
                # Without its ok the board had not begun.
                self._bearings.way = None
                raise
            self._board.has_current = True
        return ramped_turn(*ends, speed_deg_s, axis.acceleration_deg_s2, time.monotonic())

    def _wait_for_stand(self, duration_s: float) -> None:
        """`G4 P0` is answered when the motion is over."""
        self._board.dialogue.request("G4 P0", ANSWER_S + 1.2 * duration_s)
        self._board.arrived(self._board.dialogue.status())

    def _end_turn(self) -> None:
        if self._board.turn is not None:
            self._wait_for_stand(self._board.turn.duration_s)
        self._board.turn = None

    def _let_go(self) -> None:
        self._end_turn()
        self._board.sleep()


TURNTABLES.register("grbl", GrblTable)
