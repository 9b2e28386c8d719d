"""The Marlin driver against the emulated boards with versions 1.1.1 and 2.0."""

import re
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from turntable_contract import TurntableContract, plant_state, wait_until

from app.devices.marlin_dialogue import MarlinDialogue
from app.devices.turntables.marlin import Marlin as Driver
from app.errors import (
    DeviceError,
    DeviceRefused,
    DeviceUnrecognised,
    MoveStopped,
    OptionError,
    PositionUnknown,
)
from app.simulation.clock import Clock
from app.simulation.firmware.dialects.fabscan import FabScan
from app.simulation.firmware.dialects.marlin import Marlin as Board
from app.simulation.firmware.kernel import Firmware
from app.simulation.firmware.plant import Plant, Wiring
from app.simulation.firmware.port import EmulatedPort

_STEP_DEG = 360.0 / 3200.0


_RATE = 16.0


@pytest.fixture(autouse=True)
def _less_patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """The emulated world runs faster."""
    monkeypatch.setattr("app.devices.marlin_dialogue.ANSWER_S", 1.0)
    monkeypatch.setattr("app.devices.marlin_dialogue._SILENCE_S", 1.2)


class HurriedDialogue(MarlinDialogue):
    """Waits for moves as long as they take in a world that runs faster."""

    def wait(self, duration_s: float) -> None:
        super().wait(duration_s / _RATE)


def quick(port: str, **options: object) -> Driver:
    """A driver for a world that runs faster."""
    driver = Driver(port, **options)  # type: ignore[arg-type]
    driver._board.dialogue = HurriedDialogue(driver._link)
    return driver


def board(plant: Plant, version: str = "1.1.1", table_axis: str = "X") -> Board:
    return Board(plant, version, table_axis, fan_lasers={0: 0, 1: 1})


class TestMarlin1(TurntableContract):
    rate = _RATE

    def make_firmware(self, plant: Plant) -> Firmware:
        return board(plant)

    def make_driver(self, port: str) -> Driver:
        return quick(port)


class TestMarlin2(TurntableContract):
    rate = _RATE

    def make_firmware(self, plant: Plant) -> Firmware:
        return board(plant, "2.0.9.3")

    def make_driver(self, port: str) -> Driver:
        return quick(port, laser="M106", lasers=(0, 1))


@contextmanager
def bench(
    folder: Path,
    version: str = "2.0.9.3",
    axis: str = "X",
    *,
    rate: float = _RATE,
    resets_on_open: bool = True,
) -> Iterator[EmulatedPort]:
    firmware = board(Plant(Wiring(3200.0)), version, axis)
    with EmulatedPort(firmware, folder / "port", Clock(rate), resets_on_open=resets_on_open) as emulator:
        yield emulator


@contextmanager
def connected(emulator: EmulatedPort, **options: object) -> Iterator[Driver]:
    driver = quick(str(emulator.link), **({"laser": "M106", "lasers": (0, 1)} | options))
    driver.connect()
    try:
        yield driver
    finally:
        driver.disconnect()


@pytest.fixture
def emulator(tmp_path: Path) -> Iterator[EmulatedPort]:
    with bench(tmp_path) as emulator:
        yield emulator


@pytest.fixture
def table(emulator: EmulatedPort) -> Iterator[Driver]:
    with connected(emulator) as table:
        yield table


@pytest.fixture
def old_emulator(tmp_path: Path) -> Iterator[EmulatedPort]:
    with bench(tmp_path, "1.1.1") as emulator:
        yield emulator


def said(table: Driver) -> list[str]:
    """What the driver says from now on."""
    lines: list[str] = []

    def note(way: str, data: bytes) -> None:
        if way == ">":
            lines.extend(data.decode().split("\n"))

    table._link.transcript = note
    return lines


class Background(threading.Thread):
    """Something that another thread does, and how it ended."""

    def __init__(self, deed: Callable[[], object]) -> None:
        super().__init__(daemon=True)
        self.deed, self.error = deed, None
        self.start()

    error: DeviceError | None

    def run(self) -> None:
        try:
            self.deed()
        except DeviceError as error:
            self.error = error

    def ended(self) -> DeviceError | None:
        self.join(20.0)
        assert not self.is_alive()
        return self.error


def test_a_board_with_a_splash_screen_is_waited_for(tmp_path: Path) -> None:
    with bench(tmp_path, "1.1.1", rate=3.0) as emulator, connected(emulator) as table:
        assert table.facts.firmware == "Marlin 1.1.1"
        assert emulator.clock.now_s() > 6.9


def test_a_move_below_zero_is_made_though_the_end_switch_reads_pressed(old_emulator: EmulatedPort) -> None:
    with connected(old_emulator) as table:
        reached = table.move_to(-45.0)
        assert reached == pytest.approx(-45.0, abs=0.5 * _STEP_DEG)
        assert plant_state(old_emulator).angle_deg == pytest.approx(reached, abs=1e-6)


def test_a_table_that_an_end_switch_holds_is_noticed(old_emulator: EmulatedPort) -> None:
    with connected(old_emulator) as table:
        table.talk("M120")
        with pytest.raises(DeviceError, match=r"stopped at -0\.22 instead of -45\.00 degrees"):
            table.move_to(-45.0)
        assert plant_state(old_emulator).angle_deg == pytest.approx(table.angle_deg, abs=1e-6)


def test_the_table_may_turn_beyond_the_bed(table: Driver, emulator: EmulatedPort) -> None:
    assert table.move_to(720.0) == pytest.approx(720.0)
    assert plant_state(emulator).angle_deg == pytest.approx(720.0)


def test_lasers_on_pins_light_with_m42(old_emulator: EmulatedPort) -> None:
    with connected(old_emulator, laser="M42", lasers=(11, 6)) as table:
        for output, pin in enumerate((11, 6)):
            table.set_laser(pin, True)
            assert plant_state(old_emulator).outputs_on == {output}
            table.set_laser(pin, False)


def test_a_board_without_m42_names_the_other_option(emulator: EmulatedPort) -> None:
    table = quick(str(emulator.link))
    with pytest.raises(DeviceRefused, match="does not know M42") as told:
        table.connect()
    assert 'laser = "M106"' in told.value.hint
    assert not table.is_connected


def test_a_laser_is_switched_while_the_table_turns_steadily(table: Driver, emulator: EmulatedPort) -> None:
    table.start_turning(180.0, 60.0)
    table.set_laser(1, True)
    state = plant_state(emulator)
    assert state.is_moving
    assert state.outputs_on == {1}
    table.set_laser(1, False)
    table.finish_turning()


def test_settings_are_set_only_where_they_differ_and_never_stored(emulator: EmulatedPort) -> None:
    with connected(emulator) as table:
        assert emulator.firmware.motion.per_mm[0] == pytest.approx(3200 / 360)  # type: ignore[attr-defined]
        lines = said(table)
        table._board.set_up()
        assert any(line.startswith("M92 X") for line in lines)
        table._bearings.per_deg = 80.2
        table._board.ask("M92 X80.2")
        lines.clear()
        table._board.set_up()
        assert not any(line.startswith(("M92", "M500", "M502")) for line in lines)


def test_the_extruder_turns_the_table_in_parts_that_the_firmware_allows(tmp_path: Path) -> None:
    with bench(tmp_path, axis="E") as emulator, connected(emulator, axis="E") as table:
        lines = said(table)
        reached = table.move_to(540.0)
        assert reached == pytest.approx(540.0)
        assert plant_state(emulator).angle_deg == pytest.approx(540.0)
        assert len([line for line in lines if line.startswith("G1 E")]) == 3
        assert table.move_to(-9.0) == pytest.approx(-9.0)
        assert plant_state(emulator).angle_deg == pytest.approx(-9.0)


def test_a_steady_turn_on_the_extruder_is_one(tmp_path: Path) -> None:
    with bench(tmp_path, axis="E") as emulator, connected(emulator, axis="E") as table:
        turn = table.start_turning(360.0, 200.0)
        assert table.finish_turning() == pytest.approx(360.0)
        assert turn.duration_s == pytest.approx(360.0 / 200.0 + 200.0 / 200.0)
        assert plant_state(emulator).angle_deg == pytest.approx(360.0)


def test_a_cold_extruder_that_refuses_is_told_and_has_not_moved(tmp_path: Path) -> None:
    with bench(tmp_path, axis="E") as emulator, connected(emulator, axis="E") as table:
        table.talk("M302 P0")
        with pytest.raises(DeviceRefused, match="cold extrusion prevented"):
            table.move_to(9.0)
        assert table.angle_deg == 0.0
        table.talk("M302 P1")
        assert table.move_to(9.0) == pytest.approx(9.0)
        assert plant_state(emulator).angle_deg == pytest.approx(9.0)


def test_where_a_stopped_extruder_stands_nobody_knows(tmp_path: Path) -> None:
    with bench(tmp_path, axis="E") as emulator, connected(emulator, axis="E") as table:
        mover = Background(lambda: table.move_to(170.0))
        wait_until(lambda: plant_state(emulator).angle_deg > 20.0)
        with pytest.raises(PositionUnknown) as told:
            table.stop()
        assert isinstance(mover.ended(), MoveStopped)
        stood = plant_state(emulator).angle_deg
        assert told.value.lowest_deg <= stood <= told.value.highest_deg
        with pytest.raises(PositionUnknown):
            table.connect()
        table.zero(stood)
        reached = table.move_to(stood + 9.0)
        assert plant_state(emulator).angle_deg == pytest.approx(reached, abs=_STEP_DEG)


def test_a_reset_while_it_stands_keeps_angle_and_lasers(table: Driver, emulator: EmulatedPort) -> None:
    reached = table.move_to(30.0)
    table.set_laser(0, True)
    emulator.reset()
    wait_until(lambda: not plant_state(emulator).outputs_on)
    again = table.move_to(60.0)
    assert table.angle_deg == again
    assert again == pytest.approx(60.0, abs=0.5 * _STEP_DEG)
    state = plant_state(emulator)
    assert state.angle_deg == pytest.approx(again, abs=1e-6)
    assert state.outputs_on == {0}
    assert reached == pytest.approx(30.0, abs=0.5 * _STEP_DEG)


def test_a_reset_in_mid_move_loses_the_position_and_no_laser_stays_dark(
    emulator: EmulatedPort,
) -> None:
    with connected(emulator) as table:
        table.set_laser(1, True)
        mover = Background(lambda: table.move_to(200.0))
        wait_until(lambda: plant_state(emulator).angle_deg > 20.0)
        emulator.reset()
        error = mover.ended()
        assert isinstance(error, PositionUnknown)
        stood = plant_state(emulator).angle_deg
        assert error.lowest_deg <= stood <= error.highest_deg
        assert plant_state(emulator).outputs_on == {1}
        with pytest.raises(PositionUnknown):
            table.move_to(0.0)
        with pytest.raises(PositionUnknown):
            table.connect()
        table.zero(stood)
        reached = table.move_to(stood + 9.0)
        assert plant_state(emulator).angle_deg == pytest.approx(reached, abs=_STEP_DEG)


def test_a_halted_board_says_what_to_do_and_is_cured_by_connecting_again(
    table: Driver, emulator: EmulatedPort
) -> None:
    reached = table.move_to(20.0)
    table.set_laser(0, True)
    with pytest.raises(DeviceError, match="halted itself") as told:
        table.talk("M112")
    assert "connect again" in told.value.hint
    assert plant_state(emulator).outputs_on == {0}
    table.connect()
    assert not plant_state(emulator).outputs_on
    assert table.angle_deg == reached
    assert table.move_to(0.0) == 0.0


def test_a_halted_board_is_made_safe_by_a_reset(table: Driver, emulator: EmulatedPort) -> None:
    table.set_laser(0, True)
    table._link.write(b"M112\n")
    table.make_safe()
    assert not plant_state(emulator).outputs_on
    assert table.move_to(9.0) == pytest.approx(9.0)


def test_a_board_that_is_busy_is_waited_for(emulator: EmulatedPort) -> None:
    with connected(emulator) as table:
        table._link.write(b"G4 S30\n")
        assert table.move_to(9.0) == pytest.approx(9.0)
        assert plant_state(emulator).angle_deg == pytest.approx(9.0)


def test_values_behind_an_ok_are_told(table: Driver) -> None:
    assert table.talk("M105") == "T:25 /0 B:25 /0 @:0 B@:0"
    assert table.talk("hello") == 'echo:Unknown command: "hello"'


def test_a_position_typed_in_does_not_turn_the_table(table: Driver, emulator: EmulatedPort) -> None:
    reached = table.move_to(45.0)
    table.talk("G92 X100")
    assert table.angle_deg == reached
    again = table.move_to(54.0)
    assert plant_state(emulator).angle_deg == pytest.approx(again, abs=1e-6)


def test_a_move_typed_in_is_counted(table: Driver, emulator: EmulatedPort) -> None:
    table.talk("G1 X45 F6000")
    assert table.angle_deg == pytest.approx(45.0)
    assert table.move_to(0.0) == 0.0
    assert plant_state(emulator).angle_deg == pytest.approx(0.0)


def test_a_board_that_opening_does_not_reset_is_asked(tmp_path: Path) -> None:
    with bench(tmp_path, resets_on_open=False) as emulator:
        first = quick(str(emulator.link), laser="M106", lasers=(0, 1))
        first.connect()
        first.set_laser(1, True)
        first._link.close()
        with connected(emulator) as second:
            assert not plant_state(emulator).outputs_on
            assert second.move_to(9.0) == pytest.approx(9.0)


def test_a_board_at_another_rate_needs_that_rate(tmp_path: Path) -> None:
    with bench(tmp_path) as emulator:
        emulator.firmware.baud = 250000
        wrong = quick(str(emulator.link), laser="M106", lasers=(0, 1))
        with pytest.raises(DeviceUnrecognised, match="does not answer as Marlin"):
            wrong.connect()
        with connected(emulator, baud=250000) as table:
            assert table.move_to(9.0) == pytest.approx(9.0)


def test_another_board_is_named_by_what_it_is_not(tmp_path: Path) -> None:
    stranger = FabScan(Plant(Wiring(3200.0)), baud=115200)
    with EmulatedPort(stranger, tmp_path / "port", Clock(10.0)) as emulator:
        table = quick(str(emulator.link))
        with pytest.raises(DeviceUnrecognised, match="does not answer as Marlin"):
            table.connect()
        assert not table.is_connected


@pytest.mark.parametrize(
    "options",
    [
        {"axis": "Q"},
        {"laser": "M3"},
        {"steps_per_deg": 0.0},
        {"speed": float("nan")},
        {"acceleration": -1.0},
        {"slowest_steps": float("nan")},
        {"lasers": ["11 S255"]},
    ],
)
def test_options_that_make_no_table_are_refused(options: dict[str, object]) -> None:
    with pytest.raises(OptionError):
        quick("nowhere", **options)


def test_the_farewell_stops_and_darkens_in_the_words_of_the_board() -> None:
    fans, printer = quick("x", laser="M106", lasers=(0, 1)), quick("x", laser="M700", lasers=(0,))
    assert fans.farewell is not None
    assert [word for word, _ in fans.farewell.words] == [
        b"\nM107 P0\nM107 P1\n",
        b"M410\n",
        b"M107 P0\nM107 P1\nM18\n",
    ]
    assert printer.farewell is not None
    assert re.search(rb"M700 S0\nM18\n$", printer.farewell.words[-1][0])
