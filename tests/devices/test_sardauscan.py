"""The Sardauscan's driver against its emulated board."""

import threading
from pathlib import Path

import pytest
from turntable_contract import TurntableContract, plant_state, wait_until

from app.devices.turntable import Turntable
from app.devices.turntables.sardauscan import Sardauscan, piece_s
from app.errors import DeviceError, DeviceRefused, DeviceUnrecognised, PositionUnknown
from app.simulation.clock import Clock
from app.simulation.firmware.dialects import sardauscan
from app.simulation.firmware.dialects.fabscan100 import FabScan100
from app.simulation.firmware.kernel import Firmware
from app.simulation.firmware.plant import Plant, Wiring
from app.simulation.firmware.port import EmulatedPort


@pytest.fixture(autouse=True)
def _less_patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """The emulated world runs ten times as fast."""
    monkeypatch.setattr("app.devices.turntables.sardauscan._BANNER_S", 0.8)
    monkeypatch.setattr("app.devices.turntables.sardauscan._PATIENCE_S", 1.0)


class TestSardauscan(TurntableContract):
    steps_per_turn = 4072.0

    def make_firmware(self, plant: Plant) -> Firmware:
        return sardauscan.Sardauscan(plant)

    def make_driver(self, port: str) -> Turntable:
        return Sardauscan(port)

    def test_it_says_what_the_board_has(self, table: Turntable) -> None:
        assert table.facts.firmware == "Sardauscan 0.1a"
        assert table.facts.laser_channels == (0, 1, 2, 3)
        assert table.facts.smallest_deg == pytest.approx(360.0 / 1018.0)

    def test_a_steady_turn_is_refused_with_advice(self, table: Turntable) -> None:
        with pytest.raises(DeviceRefused, match="one speed") as told:
            table.start_turning(90.0, 15.0)
        assert "step by step" in told.value.hint

    def test_many_turns_do_not_overflow_sixteen_bits(self, table: Turntable, emulator: EmulatedPort) -> None:
        table.move_to(4.0)
        driver = table
        assert isinstance(driver, Sardauscan)
        # As if eight turns had been made: only the board's count matters, and the turns take minutes.
        emulator.firmware._position += 4 * 7990  # type: ignore[attr-defined]
        driver._bearings.count_anew(driver._bearings.at + 7990)
        reached = table.move_to(30.0)
        assert plant_state(emulator).angle_deg == pytest.approx(reached, abs=0.01)

    def test_a_lit_laser_goes_out_within_a_second_of_make_safe(
        self, table: Turntable, emulator: EmulatedPort
    ) -> None:
        table.set_laser(1, True)
        mover = threading.Thread(target=lambda: _move(table, 200.0), daemon=True)
        mover.start()
        wait_until(lambda: plant_state(emulator).angle_deg > 5.0)
        asked_s = emulator.clock.now_s()
        table.make_safe()
        mover.join(10.0)
        # A piece of 1 s, and what a busy machine adds, ten times as fast.
        went_out = [event.time_s for event in emulator.firmware.plant.events if event.what == "laser off"]
        assert went_out[-1] - asked_s < piece_s(12) + 1.0
        assert not plant_state(emulator).outputs_on

    def test_a_board_that_resets_itself_while_it_stands_keeps_the_angle(
        self, table: Turntable, emulator: EmulatedPort
    ) -> None:
        table.move_to(30.0)
        emulator.reset()
        _wait_for_boot(emulator)
        reached = table.move_to(60.0)
        assert plant_state(emulator).angle_deg == pytest.approx(reached, abs=0.4)

    def test_a_reset_that_is_noticed_only_on_connecting_again_keeps_the_angle(
        self, table: Turntable, emulator: EmulatedPort
    ) -> None:
        reached = table.move_to(30.0)
        emulator.reset()
        _wait_for_boot(emulator)
        table.connect()
        assert table.angle_deg == reached
        # The banner itself may be missed, too: then the count tells.
        emulator.silence(3.0)
        emulator.reset()
        _wait_for_boot(emulator)
        emulator.silence(0.0)
        table.connect()
        assert table.angle_deg == reached
        reached = table.move_to(60.0)
        assert plant_state(emulator).angle_deg == pytest.approx(reached, abs=0.01)

    def test_a_board_that_resets_itself_in_mid_move_does_not_know_where_it_stands(
        self, table: Turntable, emulator: EmulatedPort
    ) -> None:
        told: list[PositionUnknown] = []
        mover = threading.Thread(target=lambda: told.append(_lost(table, 300.0)), daemon=True)
        mover.start()
        wait_until(lambda: plant_state(emulator).angle_deg > 20.0)
        emulator.reset()
        mover.join(20.0)
        true = plant_state(emulator).angle_deg
        assert told[0].lowest_deg - 0.5 <= true <= told[0].highest_deg + 0.5
        assert told[0].highest_deg - told[0].lowest_deg < 20.0

    def test_a_board_that_does_not_reset_keeps_its_place(self, tmp_path: Path) -> None:
        plant = Plant(Wiring(self.steps_per_turn))
        firmware = sardauscan.Sardauscan(plant)
        with EmulatedPort(firmware, tmp_path / "p", Clock(10.0), resets_on_open=False) as emulator:
            wait_until(lambda: emulator.firmware.due_s == float("inf"))
            table = Sardauscan(str(emulator.link))
            table.connect()
            table.move_to(40.0)
            table.disconnect()
            table.connect()
            assert table.angle_deg == pytest.approx(40.0, abs=0.2)
            reached = table.move_to(50.0)
            assert plant_state(emulator).angle_deg == pytest.approx(reached, abs=0.01)
            table.disconnect()

    def test_what_an_earlier_program_left_in_the_buffer_spoils_nothing(
        self, table: Turntable, emulator: EmulatedPort
    ) -> None:
        emulator.firmware.receive(b"M115", emulator.clock.now_s())
        table.connect()
        assert table.move_to(5.0) == pytest.approx(5.0, abs=0.2)

    def test_another_board_is_named(self, tmp_path: Path) -> None:
        firmware = FabScan100(Plant(Wiring(3200.0)))
        with EmulatedPort(firmware, tmp_path / "p", Clock(10.0)) as emulator:
            table = Sardauscan(str(emulator.link))
            with pytest.raises(DeviceUnrecognised):
                table.connect()
            assert not table.is_connected


def _move(table: Turntable, angle_deg: float) -> None:
    try:
        table.move_to(angle_deg)
    except DeviceError:
        return


def _lost(table: Turntable, angle_deg: float) -> PositionUnknown:
    try:
        table.move_to(angle_deg)
    except PositionUnknown as error:
        return error
    raise AssertionError("the move ended")


def _wait_for_boot(emulator: EmulatedPort) -> None:
    ends = emulator.clock.now_s() + 1.5
    wait_until(lambda: emulator.clock.now_s() > ends)
