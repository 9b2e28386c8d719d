"""What every controller board must do, run against its emulator behind a pseudo-terminal.

A board's test module subclasses `TurntableContract` and says how to build the firmware and the driver.
"""

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from app.devices.turntable import Turntable
from app.errors import DeviceError, DeviceLost, DeviceTimeout, MoveStopped, PositionUnknown
from app.simulation.clock import Clock
from app.simulation.firmware.kernel import Firmware
from app.simulation.firmware.plant import Plant, PlantState, Wiring
from app.simulation.firmware.port import EmulatedPort

_SOON_S = 60.0


class TurntableContract:
    """Attributes that a subclass sets.

    Attributes:
        steps_per_turn: of the wired table, in the board's pulses.
        rate: how much faster than real the emulated world runs.
        steady_deg: how far a steady turn goes.
    """

    steps_per_turn = 3200.0
    rate = 10.0
    steady_deg = 90.0

    def make_firmware(self, plant: Plant) -> Firmware:
        raise NotImplementedError

    def make_driver(self, port: str) -> Turntable:
        raise NotImplementedError

    @pytest.fixture
    def emulator(self, tmp_path: Path) -> Iterator[EmulatedPort]:
        plant = Plant(Wiring(self.steps_per_turn))
        with EmulatedPort(self.make_firmware(plant), tmp_path / "port", Clock(self.rate)) as emulator:
            yield emulator

    @pytest.fixture
    def table(self, emulator: EmulatedPort) -> Iterator[Turntable]:
        driver = self.make_driver(str(emulator.link))
        driver.connect()
        yield driver
        driver.disconnect()

    def test_a_move_returns_when_the_table_stands_where_it_says(
        self, table: Turntable, emulator: EmulatedPort
    ) -> None:
        for asked in (9.0, 1.0, 91.5, -30.0):
            reached = table.move_to(asked)
            state = plant_state(emulator)
            assert not state.is_moving
            assert state.angle_deg == pytest.approx(reached, abs=1e-3 + 0.01 * table.facts.smallest_deg)
            assert reached == pytest.approx(asked, abs=0.51 * table.facts.smallest_deg)
            assert table.angle_deg == reached

    def test_small_steps_do_not_add_up_their_rounding(self, table: Turntable, emulator: EmulatedPort) -> None:
        for number in range(1, 13):
            table.move_to(number * 1.7)
        assert plant_state(emulator).angle_deg == pytest.approx(
            20.4, abs=0.51 * table.facts.smallest_deg + 1e-3
        )

    def test_a_laser_lights_alone_and_goes_out(self, table: Turntable, emulator: EmulatedPort) -> None:
        for channel in table.facts.laser_channels:
            table.set_laser(channel, True)
            assert len(plant_state(emulator).outputs_on) == 1
            table.set_laser(channel, False)
            assert not plant_state(emulator).outputs_on

    def test_every_channel_lights_another_laser(self, table: Turntable, emulator: EmulatedPort) -> None:
        lit = []
        for channel in table.facts.laser_channels:
            table.set_laser(channel, True)
            lit.append(plant_state(emulator).outputs_on)
            table.set_laser(channel, False)
        assert len(set(lit)) == len(lit)

    def test_an_unknown_laser_is_refused(self, table: Turntable, emulator: EmulatedPort) -> None:
        with pytest.raises(DeviceError):
            table.set_laser(max(table.facts.laser_channels) + 7, True)
        assert not plant_state(emulator).outputs_on

    def test_make_safe_puts_everything_out(self, table: Turntable, emulator: EmulatedPort) -> None:
        for channel in table.facts.laser_channels:
            table.set_laser(channel, True)
        table.make_safe()
        assert not plant_state(emulator).outputs_on

    def test_disconnecting_puts_the_lasers_out(self, table: Turntable, emulator: EmulatedPort) -> None:
        table.set_laser(table.facts.laser_channels[0], True)
        table.disconnect()
        assert not plant_state(emulator).outputs_on
        assert not table.is_connected

    def test_make_safe_in_mid_move_puts_the_lasers_out(
        self, table: Turntable, emulator: EmulatedPort
    ) -> None:
        table.set_laser(table.facts.laser_channels[0], True)
        mover = _Move(table, 300.0)
        wait_until(lambda: plant_state(emulator).is_moving)
        table.make_safe()
        mover.join()
        wait_until(lambda: not plant_state(emulator).outputs_on)

    def test_stop_overtakes_a_move_and_the_position_is_known(
        self, table: Turntable, emulator: EmulatedPort
    ) -> None:
        if not table.facts.can_stop:
            pytest.skip("this board cannot stop a move")
        mover = _Move(table, 300.0)
        wait_until(lambda: plant_state(emulator).angle_deg > 20.0)
        stood = table.stop()
        mover.join()
        assert isinstance(mover.error, MoveStopped)
        assert stood < 290.0
        assert plant_state(emulator).angle_deg == pytest.approx(stood, abs=table.facts.smallest_deg)
        reached = table.move_to(0.0)
        assert plant_state(emulator).angle_deg == pytest.approx(reached, abs=table.facts.smallest_deg)

    def test_two_may_stop_it_at_once(self, table: Turntable, emulator: EmulatedPort) -> None:
        if not table.facts.can_stop:
            pytest.skip("this board cannot stop a move")
        mover = _Move(table, 300.0)
        wait_until(lambda: plant_state(emulator).angle_deg > 20.0)
        stopper = threading.Thread(target=table.make_safe, daemon=True)
        stopper.start()
        stood = table.stop()
        stopper.join(30.0)
        mover.join()
        assert not stopper.is_alive()
        assert plant_state(emulator).angle_deg == pytest.approx(stood, abs=table.facts.smallest_deg)

    def test_an_unplugged_board_is_lost_and_comes_back_where_it_was(
        self, table: Turntable, emulator: EmulatedPort
    ) -> None:
        reached = table.move_to(33.0)
        emulator.unplug()
        wait_until(lambda: not table.is_connected)
        with pytest.raises(DeviceLost):
            table.move_to(50.0)
        emulator.plug_in()
        table.connect()
        assert table.angle_deg == reached
        again = table.move_to(66.0)
        assert plant_state(emulator).angle_deg == pytest.approx(again, abs=1.01 * table.facts.smallest_deg)
        assert not plant_state(emulator).outputs_on

    def test_unplugged_in_mid_move_the_position_is_unknown_until_somebody_tells(
        self, table: Turntable, emulator: EmulatedPort
    ) -> None:
        mover = _Move(table, 300.0)
        wait_until(lambda: plant_state(emulator).angle_deg > 20.0)
        emulator.unplug()
        mover.join()
        assert isinstance(mover.error, DeviceLost)
        emulator.plug_in()
        with pytest.raises(PositionUnknown) as told:
            table.connect()
        true = plant_state(emulator).angle_deg
        assert told.value.lowest_deg - 1.0 <= true <= told.value.highest_deg + 1.0
        for _ in range(2):
            with pytest.raises(PositionUnknown) as again:
                table.connect()
            assert (again.value.lowest_deg, again.value.highest_deg) == (
                told.value.lowest_deg, told.value.highest_deg,
            )  # fmt: skip
        with pytest.raises(PositionUnknown):
            table.move_to(true)
        table.zero(true)
        table.connect()
        reached = table.move_to(true + 10.0)
        assert plant_state(emulator).angle_deg == pytest.approx(reached, abs=1.01 * table.facts.smallest_deg)

    def test_silence_is_a_timeout_and_afterwards_all_is_well(
        self, table: Turntable, emulator: EmulatedPort
    ) -> None:
        emulator.silence(600.0)
        with pytest.raises((DeviceTimeout, PositionUnknown)):
            table.move_to(5.0)
        emulator.silence(0.0)
        try:
            table.connect()
        except PositionUnknown:
            # A board that cannot be asked where it stands may or may not have heard the command.
            table.zero(plant_state(emulator).angle_deg)
        reached = table.move_to(10.0)
        assert plant_state(emulator).angle_deg == pytest.approx(reached, abs=1.01 * table.facts.smallest_deg)

    def test_a_laser_whose_command_is_not_answered_goes_out_at_once(
        self, table: Turntable, emulator: EmulatedPort
    ) -> None:
        channel = table.facts.laser_channels[0]
        began_s = emulator.clock.now_s()
        emulator.silence(600.0)
        with pytest.raises(DeviceError):
            table.set_laser(channel, True)
        wait_until(lambda: not plant_state(emulator).outputs_on)
        # In real seconds, as the driver's patience is: half a second, and what a busy machine adds.
        assert all(lit_s / self.rate < 2.0 for lit_s in _lit_times(emulator, began_s))
        emulator.silence(0.0)
        table.set_laser(channel, True)
        assert len(plant_state(emulator).outputs_on) == 1
        table.set_laser(channel, False)
        assert not plant_state(emulator).outputs_on

    def test_garbage_between_commands_is_thrown_away(self, table: Turntable, emulator: EmulatedPort) -> None:
        for _ in range(5):
            emulator.garbage(40)
            time.sleep(0.05)
            reached = table.move_to(table.angle_deg + 5.0)
        assert plant_state(emulator).angle_deg == pytest.approx(reached, abs=1.01 * table.facts.smallest_deg)

    def test_a_steady_turn_has_the_speed_it_says(self, table: Turntable, emulator: EmulatedPort) -> None:
        if not table.facts.can_turn_steadily:
            pytest.skip("this board has no choice of speed")
        turn = table.start_turning(self.steady_deg, 15.0)
        reached = table.finish_turning()
        assert reached == pytest.approx(self.steady_deg, abs=table.facts.smallest_deg)
        assert plant_state(emulator).angle_deg == pytest.approx(reached, abs=table.facts.smallest_deg)
        assert turn.speed_deg_s == pytest.approx(15.0, rel=0.25)
        assert turn.duration_s == pytest.approx(self.steady_deg / turn.speed_deg_s, rel=0.2)

    def test_too_slow_a_turn_is_refused(self, table: Turntable) -> None:
        if table.facts.slowest_deg_s <= 0.0 or not table.facts.can_turn_steadily:
            pytest.skip("this board turns as slowly as one likes")
        with pytest.raises(DeviceError):
            table.start_turning(10.0, 0.5 * table.facts.slowest_deg_s)

    def test_two_threads_may_switch_and_turn(self, table: Turntable, emulator: EmulatedPort) -> None:
        mover = _Move(table, 20.0)
        table.set_laser(table.facts.laser_channels[0], True)
        table.set_laser(table.facts.laser_channels[0], False)
        mover.join()
        assert mover.error is None
        assert not plant_state(emulator).outputs_on


class _Move(threading.Thread):
    """A move that somebody else waits for."""

    def __init__(self, table: Turntable, angle_deg: float) -> None:
        super().__init__(daemon=True)
        self.table, self.angle_deg = table, angle_deg
        self.error: DeviceError | None = None
        self.start()

    def run(self) -> None:
        try:
            self.table.move_to(self.angle_deg)
        except DeviceError as error:
            self.error = error

    def join(self, timeout: float | None = 60.0) -> None:
        super().join(timeout)
        assert not self.is_alive(), "the move never ended"


def _lit_times(emulator: EmulatedPort, since_s: float) -> list[float]:
    """How long lasers were on, seconds of the world."""
    lit: dict[int, float] = {}
    times = []
    for event in emulator.firmware.plant.events:
        if event.time_s > since_s and event.what == "laser on":
            lit[event.output] = event.time_s
        elif event.what == "laser off" and event.output in lit:
            times.append(event.time_s - lit.pop(event.output))
    return times


def plant_state(emulator: EmulatedPort) -> PlantState:
    """The machine now."""
    return emulator.firmware.plant.at(emulator.clock.now_s())


def wait_until(is_so: Callable[[], bool], timeout_s: float = _SOON_S) -> None:
    """Look until something is so."""
    ends = time.monotonic() + timeout_s
    while not is_so():
        assert time.monotonic() < ends, "it never came to be"
        time.sleep(0.002)
