"""The FabScan100's driver against its emulated board."""

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from turntable_contract import TurntableContract, plant_state, wait_until

from app.devices.serial_link import SerialLink
from app.devices.turntable import Turntable
from app.devices.turntables.fabscan100 import FabScan100
from app.errors import DeviceRefused, DeviceUnrecognised, MoveStopped, PositionUnknown
from app.simulation.clock import Clock
from app.simulation.firmware.dialects import fabscan100
from app.simulation.firmware.dialects.sardauscan import Sardauscan
from app.simulation.firmware.kernel import Firmware
from app.simulation.firmware.plant import Plant, Wiring
from app.simulation.firmware.port import EmulatedPort


@pytest.fixture(autouse=True)
def _less_patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """The emulated world runs ten times as fast."""
    monkeypatch.setattr("app.devices.fabscan100_line._BOOT_S", 1.5)


class TestFabScan100(TurntableContract):
    # It is paced by the host, in real time.
    steady_deg = 20.0

    def make_firmware(self, plant: Plant) -> Firmware:
        return fabscan100.FabScan100(plant)

    def make_driver(self, port: str) -> Turntable:
        return FabScan100(port)

    def test_the_laser_that_boots_lit_is_off_after_connecting(
        self, table: Turntable, emulator: EmulatedPort
    ) -> None:
        events = [event.what for event in emulator.firmware.plant.events if "laser" in event.what]
        assert "laser on" in events
        assert not plant_state(emulator).outputs_on

    def test_the_table_is_held_from_the_first_move_until_let_go(
        self, table: Turntable, emulator: EmulatedPort
    ) -> None:
        table.move_to(5.0)
        assert plant_state(emulator).is_holding
        table.hold(False)
        assert not plant_state(emulator).is_holding
        table.hold(True)
        assert plant_state(emulator).is_holding

    def test_a_stopped_steady_turn_says_so_and_stays_known(
        self, table: Turntable, emulator: EmulatedPort
    ) -> None:
        table.start_turning(300.0, 18.0)
        wait_until(lambda: plant_state(emulator).angle_deg > 5.0)
        stood = table.stop()
        with pytest.raises(MoveStopped):
            table.finish_turning()
        assert plant_state(emulator).angle_deg == pytest.approx(stood, abs=0.01)

    def test_during_a_steady_turn_the_laser_is_switched_and_another_move_refused(
        self, table: Turntable, emulator: EmulatedPort
    ) -> None:
        table.start_turning(10.0, 10.0)
        with pytest.raises(DeviceRefused, match="steady turn"):
            table.move_to(90.0)
        table.set_laser(1, True)
        state = plant_state(emulator)
        assert state.outputs_on
        assert state.angle_deg < 10.0
        table.set_laser(1, False)
        assert table.finish_turning() == pytest.approx(10.0, abs=0.06)

    def test_too_fast_a_turn_is_refused(self, table: Turntable) -> None:
        with pytest.raises(DeviceRefused, match="cannot turn at 30") as told:
            table.start_turning(90.0, 30.0)
        assert "18.75" in told.value.hint

    def test_the_command_without_return_is_never_sent(self, table: Turntable, emulator: EmulatedPort) -> None:
        with pytest.raises(DeviceRefused, match="209"):
            table.talk("209")
        assert table.talk("210") == "211"
        with pytest.raises(DeviceRefused):
            table.talk("M115")

    def test_a_position_beyond_one_byte_of_steps_is_reached(
        self, table: Turntable, emulator: EmulatedPort
    ) -> None:
        reached = table.move_to(-45.0)
        assert plant_state(emulator).angle_deg == pytest.approx(reached, abs=0.01)

    def test_a_command_broken_off_by_an_earlier_program_turns_nothing(
        self, table: Turntable, emulator: EmulatedPort
    ) -> None:
        emulator.firmware.receive(b"\xca", emulator.clock.now_s())
        table.connect()
        assert plant_state(emulator).angle_deg == 0.0
        assert table.move_to(5.0) == pytest.approx(5.0, abs=0.1)


class TestInRealTime:
    """A reset sends the same byte as a ping's answer; only its time tells them apart."""

    @pytest.fixture
    def emulator(self, tmp_path: Path) -> Iterator[EmulatedPort]:
        with EmulatedPort(fabscan100.FabScan100(Plant(Wiring(3200.0))), tmp_path / "port", Clock()) as port:
            yield port

    @pytest.fixture
    def table(self, emulator: EmulatedPort) -> Iterator[FabScan100]:
        driver = FabScan100(str(emulator.link))
        driver.connect()
        yield driver
        driver.disconnect()

    def test_a_reset_while_it_stands_does_not_leave_the_laser_on(
        self, table: FabScan100, emulator: EmulatedPort
    ) -> None:
        table.move_to(3.0)
        emulator.reset()
        wait_until(lambda: bool(plant_state(emulator).outputs_on))
        wait_until(lambda: not plant_state(emulator).outputs_on)
        reached = table.move_to(6.0)
        assert plant_state(emulator).angle_deg == pytest.approx(reached, abs=0.01)

    def test_after_a_reset_in_mid_move_the_position_is_unknown_and_the_laser_off(
        self, table: FabScan100, emulator: EmulatedPort
    ) -> None:
        told: list[PositionUnknown] = []
        mover = threading.Thread(target=lambda: told.append(_lost(table)), daemon=True)
        mover.start()
        wait_until(lambda: plant_state(emulator).angle_deg > 5.0)
        emulator.reset()
        mover.join(60.0)
        true = plant_state(emulator).angle_deg
        assert told[0].lowest_deg - 0.2 <= true <= told[0].highest_deg + 0.2
        assert told[0].highest_deg - told[0].lowest_deg < 8.0
        wait_until(lambda: not plant_state(emulator).outputs_on)


def test_the_farewell_puts_out_the_laser_that_opening_the_port_lights(tmp_path: Path) -> None:
    with EmulatedPort(fabscan100.FabScan100(Plant(Wiring(3200.0))), tmp_path / "p", Clock(10.0)) as emulator:
        farewell = FabScan100(str(emulator.link)).farewell
        assert farewell is not None
        link = SerialLink(farewell.port, farewell.baud, "watchdog", stop_bits=farewell.stop_bits)
        link.open()
        wait_until(lambda: bool(plant_state(emulator).outputs_on))
        for word, _ in farewell.words:
            link.write(word)
        wait_until(lambda: not plant_state(emulator).outputs_on)
        link.close()


def test_another_board_gets_no_byte(tmp_path: Path) -> None:
    firmware = Sardauscan(Plant(Wiring(4072.0)))
    with EmulatedPort(firmware, tmp_path / "p", Clock(10.0)) as emulator:
        table = FabScan100(str(emulator.link))
        with pytest.raises(DeviceUnrecognised, match="no FabScan100"):
            table.connect()
        assert not firmware.received


def _lost(table: FabScan100) -> PositionUnknown:
    try:
        table.move_to(120.0)
    except PositionUnknown as error:
        return error
    raise AssertionError("the move ended")
