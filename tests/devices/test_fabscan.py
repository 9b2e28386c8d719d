"""The FabScanPi driver against the emulated boards of several years."""

import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from turntable_contract import TurntableContract, plant_state, wait_until

from app.devices.fabscan_words import usual_counts_per_step
from app.devices.turntables.fabscan import FabScan as Driver
from app.errors import DeviceRefused, DeviceUnrecognised, OptionError, PositionUnknown
from app.simulation.clock import Clock
from app.simulation.firmware.dialects.fabscan import FabScan as Board
from app.simulation.firmware.kernel import Firmware
from app.simulation.firmware.plant import Plant, Wiring
from app.simulation.firmware.port import EmulatedPort

_STEP_DEG = 360.0 / 3200.0


@pytest.fixture(autouse=True)
def _less_patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """The emulated world runs ten times as fast."""
    monkeypatch.setattr("app.devices.fabscan_dialogue._BOOT_S", 0.6)
    monkeypatch.setattr("app.devices.fabscan_dialogue._ECHO_S", 0.5)
    monkeypatch.setattr("app.devices.fabscan_dialogue._ANSWER_S", 0.5)
    monkeypatch.setattr("app.devices.turntables.fabscan._SLACK_S", 0.8)


class TestCiclopOf2021(TurntableContract):
    rate = 25.0

    def make_firmware(self, plant: Plant) -> Firmware:
        return Board(plant)

    def make_driver(self, port: str) -> Driver:
        return Driver(port, baud=14400)


class TestHatOf2016(TurntableContract):
    rate = 25.0

    def make_firmware(self, plant: Plant) -> Firmware:
        return Board(plant, "v.20160914", board=0)

    def make_driver(self, port: str) -> Driver:
        return Driver(port, baud=115200)


@contextmanager
def board_at(folder: Path, *, version: str = "v.20210318", kind: int = 2) -> Iterator[EmulatedPort]:
    firmware = Board(Plant(Wiring(3200.0)), version, kind)
    with EmulatedPort(firmware, folder / "port", Clock(10.0)) as emulator:
        yield emulator


@pytest.fixture
def emulator(tmp_path: Path) -> Iterator[EmulatedPort]:
    with board_at(tmp_path) as emulator:
        yield emulator


@pytest.fixture
def table(emulator: EmulatedPort) -> Iterator[Driver]:
    driver = Driver(str(emulator.link), baud=14400)
    driver.connect()
    yield driver
    driver.disconnect()


def said(table: Driver) -> list[str]:
    """What the driver says from now on."""
    lines: list[str] = []

    def note(way: str, data: bytes) -> None:
        if way == ">":
            lines.append(data.decode().strip())

    table._link.transcript = note
    return lines


@pytest.mark.parametrize(
    ("version", "kind", "name", "per_step"),
    [
        ("v.20160914", 0, "FabScanPi v.20160914", 1),
        ("v.20170705", 0, "FabScanPi v.20170705", 1),
        ("v.20170302", 0, "FabScanPi v.20170302", 2),
        ("12337", 4, "FabScanPi 12337 (CNC shield)", 4),
        ("v.20240530", 5, "FabScanPi v.20240530 (HAT 2)", 4),
    ],
)
def test_every_version_is_found_at_its_rate_and_turned_by_its_scale(
    tmp_path: Path, version: str, kind: int, name: str, per_step: int
) -> None:
    with board_at(tmp_path, version=version, kind=kind) as emulator:
        table = Driver(str(emulator.link))
        table.connect()
        try:
            assert table.facts.firmware == name
            assert table.facts.slowest_deg_s == pytest.approx(_STEP_DEG / per_step)
            assert table.move_to(45.0) == 45.0
            assert plant_state(emulator).angle_deg == pytest.approx(45.0)
        finally:
            table.disconnect()


def test_the_rate_that_was_right_once_is_tried_first(tmp_path: Path) -> None:
    with board_at(tmp_path) as emulator:
        table = Driver(str(emulator.link))
        table.connect()
        link = table._link
        emulator.unplug()
        wait_until(lambda: not table.is_connected)
        emulator.plug_in()
        table.connect()
        assert table._link is link
        assert link.baud == 14400
        assert table.facts.firmware == "FabScanPi v.20210318 (Ciclop)"
        table.disconnect()


def test_the_scale_can_be_said(emulator: EmulatedPort) -> None:
    table = Driver(str(emulator.link), baud=14400, counts_per_step=2)
    table.connect()
    table.move_to(-20.0)
    assert plant_state(emulator).angle_deg == pytest.approx(-10.0, abs=_STEP_DEG)
    table.disconnect()


def test_the_first_step_after_a_reset_is_right(table: Driver, emulator: EmulatedPort) -> None:
    assert table.move_to(9.0) == 9.0
    assert plant_state(emulator).angle_deg == pytest.approx(9.0)


def test_a_reset_that_nobody_was_told_of_costs_no_step_and_lets_nothing_slip(
    table: Driver, emulator: EmulatedPort
) -> None:
    for angle_deg in (9.0, 4.5):
        emulator.reset()
        wait_until(lambda: not plant_state(emulator).is_holding)
        assert table._board.request("M200")
        assert table.move_to(angle_deg) == angle_deg
        assert plant_state(emulator).angle_deg == pytest.approx(angle_deg)
        assert plant_state(emulator).is_holding


def test_the_motor_is_held_before_it_turns(table: Driver, emulator: EmulatedPort) -> None:
    table.hold(False)
    assert not plant_state(emulator).is_holding
    table.move_to(9.0)
    assert plant_state(emulator).angle_deg == pytest.approx(9.0)


def test_only_g01_with_a_speed_turns_the_table_and_the_ring_is_left_alone(table: Driver) -> None:
    lines = said(table)
    table.set_laser(0, True)
    table.move_to(50.0)
    table.start_turning(20.0, 10.0)
    table.finish_turning()
    table.make_safe()
    known = re.compile(r"G01 T-?\d+ F[1-9]\d*;|M(17|18|19|20|21|22|200|201);")
    assert lines
    assert all(known.fullmatch(line) for line in lines), lines


def test_moves_work_after_somebody_turned_it_endlessly(emulator: EmulatedPort) -> None:
    table = Driver(str(emulator.link), baud=14400)
    table.connect()
    table._board.request("G06")
    table._board.request("G07")
    stood = plant_state(emulator).angle_deg
    table.move_to(-9.0)
    assert plant_state(emulator).angle_deg == pytest.approx(stood - 9.0, abs=0.01)
    table.disconnect()


def test_no_number_leaves_its_sixteen_bits(table: Driver, emulator: EmulatedPort) -> None:
    lines = said(table)
    turn = table.start_turning(1107.0, 60.0)
    assert table.finish_turning() == 1107.0
    assert plant_state(emulator).angle_deg == pytest.approx(1107.0)
    assert turn.speed_deg_s == pytest.approx(60.0, rel=0.01)
    counts = [int(found[1]) for line in lines if (found := re.search(r"G01 T(-?\d+)", line))]
    assert max(map(abs, counts)) <= 32767
    assert len(counts) == 3
    with pytest.raises(DeviceRefused, match="2764 degrees at most"):
        table.start_turning(4000.0, 60.0)


def test_a_long_move_goes_in_pieces_of_half_a_second(table: Driver) -> None:
    lines = said(table)
    table.move_to(90.0)
    moves = [re.fullmatch(r"G01 T(-?\d+) F(\d+);", line) for line in lines if line.startswith("G")]
    durations = [abs(int(found[1])) / int(found[2]) for found in moves if found]
    assert len(durations) == len(moves) > 5
    assert max(durations) <= 0.5


@pytest.mark.parametrize("speed", [0.005, 75.0, float("nan"), float("inf")])
def test_a_speed_that_would_hang_or_be_capped_is_refused(table: Driver, speed: float) -> None:
    with pytest.raises(DeviceRefused, match="cannot turn at"):
        table.start_turning(10.0, speed)


def test_stopping_a_steady_turn_resets_the_board_and_the_place_is_not_known(
    table: Driver, emulator: EmulatedPort
) -> None:
    table.set_laser(0, True)
    table.start_turning(300.0, 10.0)
    wait_until(lambda: plant_state(emulator).angle_deg > 5.0)
    with pytest.raises(PositionUnknown) as told:
        table.stop()
    state = plant_state(emulator)
    assert not state.is_moving
    assert not state.outputs_on
    assert told.value.lowest_deg <= state.angle_deg <= told.value.highest_deg
    with pytest.raises(PositionUnknown):
        table.finish_turning()
    table.zero(state.angle_deg)
    reached = table.move_to(state.angle_deg + 9.0)
    assert plant_state(emulator).angle_deg == pytest.approx(reached, abs=0.02)


def test_making_safe_in_a_steady_turn_does_not_wait_for_its_end(
    table: Driver, emulator: EmulatedPort
) -> None:
    table.set_laser(1, True)
    table.start_turning(300.0, 1.0)
    outcome: list[PositionUnknown] = []

    def wait() -> None:
        try:
            table.finish_turning()
        except PositionUnknown as error:
            outcome.append(error)

    waiter = threading.Thread(target=wait)
    waiter.start()
    wait_until(lambda: plant_state(emulator).is_moving)
    table.make_safe()
    waiter.join(10.0)
    assert outcome
    state = plant_state(emulator)
    assert not state.outputs_on
    assert not state.is_moving
    assert not state.is_holding


def test_a_laser_asked_for_during_a_steady_turn_is_switched_when_the_table_stands(
    table: Driver, emulator: EmulatedPort
) -> None:
    table.start_turning(27.0, 30.0)
    table.set_laser(0, True)
    state = plant_state(emulator)
    assert not state.is_moving
    assert state.outputs_on == {1}
    assert table.finish_turning() == 27.0


def test_channels_are_numbered_as_the_server_does(table: Driver, emulator: EmulatedPort) -> None:
    for channel, name in enumerate(("right", "left")):
        table.set_laser(channel, True)
        assert emulator.firmware.plant.lasers_on(emulator.clock.now_s()) == (name,)
        table.set_laser(channel, False)


def test_a_reset_in_mid_move_loses_the_position(table: Driver, emulator: EmulatedPort) -> None:
    errors: list[PositionUnknown] = []

    def move() -> None:
        try:
            table.move_to(300.0)
        except PositionUnknown as error:
            errors.append(error)

    mover = threading.Thread(target=move)
    mover.start()
    wait_until(lambda: plant_state(emulator).angle_deg > 20.0)
    emulator.reset()
    mover.join(20.0)
    (error,) = errors
    true_deg = plant_state(emulator).angle_deg
    assert error.lowest_deg - 0.01 <= true_deg <= error.highest_deg + 0.01
    assert error.highest_deg - error.lowest_deg < 15.0
    with pytest.raises(PositionUnknown):
        table.move_to(0.0)
    with pytest.raises(PositionUnknown):
        table.connect()
    table.zero(true_deg)
    reached = table.move_to(true_deg + 9.0)
    assert plant_state(emulator).angle_deg == pytest.approx(reached, abs=0.02)


@pytest.mark.parametrize("line", ["G01 T100", "G1 T100 F0;", "G06", "M05 R10 G6 B0", "M04 G06"])
def test_a_line_that_hangs_the_board_is_not_sent(table: Driver, emulator: EmulatedPort, line: str) -> None:
    with pytest.raises(DeviceRefused, match="would hang"):
        table.talk(line)
    assert not plant_state(emulator).is_moving
    assert table.talk("M200") == "v.20210318"


def test_a_board_that_hangs_is_cured_by_connecting_again(table: Driver, emulator: EmulatedPort) -> None:
    table.set_laser(0, True)
    table._link.write(b"G01 T100;\n")
    table.connect()
    assert not plant_state(emulator).outputs_on
    assert table.move_to(9.0) == 9.0


def test_a_board_that_hangs_with_a_laser_on_can_be_made_safe(table: Driver, emulator: EmulatedPort) -> None:
    table.set_laser(0, True)
    table._link.write(b"G01 T100;\n")
    table.make_safe()
    assert not plant_state(emulator).outputs_on


def test_a_move_typed_in_makes_the_position_unknown(table: Driver) -> None:
    assert table.talk("G01 T400 F800;") == ""
    with pytest.raises(PositionUnknown):
        table.move_to(0.0)
    table.zero(0.0)
    assert table.move_to(9.0) == 9.0


def test_a_board_that_is_not_reset_by_opening_keeps_its_lasers_until_the_driver_puts_them_out(
    tmp_path: Path,
) -> None:
    board = Board(Plant(Wiring(3200.0)))
    with EmulatedPort(board, tmp_path / "port", Clock(10.0), resets_on_open=False) as emulator:
        first = Driver(str(emulator.link), baud=14400)
        first.connect()
        first._board.request("M21")
        first._link.close()
        assert plant_state(emulator).outputs_on
        second = Driver(str(emulator.link), baud=14400)
        second.connect()
        assert not plant_state(emulator).outputs_on
        assert second.move_to(9.0) == 9.0
        second.disconnect()


def test_what_does_not_answer_is_named_with_the_rates_that_were_tried(tmp_path: Path) -> None:
    with board_at(tmp_path) as emulator:
        table = Driver(str(emulator.link), baud=57600)
        with pytest.raises(DeviceUnrecognised, match="57600 baud"):
            table.connect()
        assert not table.is_connected


def test_the_slowest_of_moves_still_has_a_speed(tmp_path: Path) -> None:
    with board_at(tmp_path) as emulator:
        table = Driver(str(emulator.link), baud=14400, speed=0.001)
        table.connect()
        lines = said(table)
        assert table.move_to(-_STEP_DEG) == pytest.approx(-_STEP_DEG)
        assert "G01 T-4 F1;" in lines
        table.disconnect()


def test_numbers_that_make_no_table_are_refused() -> None:
    with pytest.raises(OptionError, match="positive"):
        Driver("nowhere", steps_per_turn=0)
    with pytest.raises(OptionError, match="positive"):
        Driver("nowhere", speed=float("nan"))


def test_the_scale_by_version_follows_its_history() -> None:
    versions = ("v.20160914", "v.20170302", "v.20170705", "v.20181105", "12337", "v.20240530")
    assert [usual_counts_per_step(version) for version in versions] == [1, 2, 1, 4, 4, 4]
