"""The Grbl driver on a grblHAL board."""

from pathlib import Path

import pytest
from turntable_contract import TurntableContract, plant_state

from app.devices.turntable import Turntable
from app.devices.turntables.grbl import GrblTable
from app.errors import DeviceRefused
from app.simulation.clock import Clock
from app.simulation.firmware.dialects.grblhal import GrblHal
from app.simulation.firmware.kernel import Firmware
from app.simulation.firmware.plant import Plant, Wiring
from app.simulation.firmware.port import EmulatedPort


@pytest.fixture(autouse=True)
def _less_patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """The emulated world runs ten times as fast."""
    monkeypatch.setattr("app.devices.grbl_dialogue._BANNER_S", 0.8)
    monkeypatch.setattr("app.devices.grbl_dialogue._RESET_S", 0.8)
    monkeypatch.setattr("app.devices.grbl_dialogue.ANSWER_S", 1.0)


class TestGrblHal(TurntableContract):
    def make_firmware(self, plant: Plant) -> Firmware:
        return GrblHal(plant)

    def make_driver(self, port: str) -> Turntable:
        return GrblTable(port, steps_per_deg=80.0 / 9.0, speed_deg_s=90.0, acceleration_deg_s2=180.0)


def test_an_error_does_not_stay_for_the_commands_after_it(tmp_path: Path) -> None:
    board = GrblHal(Plant(Wiring(3200.0)))
    with EmulatedPort(board, tmp_path / "port", Clock(10.0)) as emulator:
        table = GrblTable(str(emulator.link), steps_per_deg=80.0 / 9.0, speed_deg_s=90.0)
        table.connect()
        with pytest.raises(DeviceRefused, match="error 20"):
            table.talk("M17")
        assert board.latched == 0
        table.set_laser(1, True)
        assert plant_state(emulator).outputs_on == {0}
        table.disconnect()


def test_the_table_may_be_on_the_fourth_axis(tmp_path: Path) -> None:
    board = GrblHal(Plant(Wiring(3200.0)), table_axis="A")
    with EmulatedPort(board, tmp_path / "port", Clock(10.0)) as emulator:
        table = GrblTable(str(emulator.link), axis="a", steps_per_deg=80.0 / 9.0, speed_deg_s=90.0)
        table.connect()
        reached = table.move_to(20.0)
        assert plant_state(emulator).angle_deg == pytest.approx(reached, abs=0.01)
        table.disconnect()


def test_it_turns_as_slowly_as_one_likes(tmp_path: Path) -> None:
    with EmulatedPort(GrblHal(Plant(Wiring(3200.0))), tmp_path / "port", Clock(10.0)) as emulator:
        table = GrblTable(str(emulator.link), steps_per_deg=80.0 / 9.0)
        table.connect()
        assert table.facts.firmware == "grblHAL 1.1f"
        assert table.start_turning(1.0, 1.0).speed_deg_s == 1.0
        assert table.finish_turning() == pytest.approx(1.0, abs=0.06)
        table.disconnect()
