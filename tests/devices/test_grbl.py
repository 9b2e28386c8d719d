"""The Grbl driver, and every trap that the board lays."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import serial
from turntable_contract import TurntableContract, plant_state, wait_until

from app.devices.grbl_dialogue import GrblDialogue, parse_status
from app.devices.serial_link import SerialLink
from app.devices.turntable import Turntable
from app.devices.turntables.grbl import GrblTable
from app.errors import (
    DeviceError,
    DeviceRefused,
    DeviceUnrecognised,
    MoveStopped,
    OptionError,
    PositionUnknown,
)
from app.simulation.clock import Clock
from app.simulation.firmware.dialects.grbl import Grbl
from app.simulation.firmware.grbl_machine import COOLANT, SPINDLE, State
from app.simulation.firmware.kernel import Firmware
from app.simulation.firmware.plant import Plant, Wiring
from app.simulation.firmware.port import EmulatedPort

_OPTIONS = {"steps_per_deg": 80.0 / 9.0, "speed_deg_s": 90.0, "acceleration_deg_s2": 180.0}


@pytest.fixture(autouse=True)
def _less_patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """The emulated world runs ten times as fast."""
    monkeypatch.setattr("app.devices.grbl_dialogue._BANNER_S", 0.8)
    monkeypatch.setattr("app.devices.grbl_dialogue._RESET_S", 0.8)
    monkeypatch.setattr("app.devices.grbl_dialogue.ANSWER_S", 1.0)


class TestGrbl(TurntableContract):
    def make_firmware(self, plant: Plant) -> Firmware:
        return Grbl(plant)

    def make_driver(self, port: str) -> Turntable:
        return GrblTable(port, **_OPTIONS)  # type: ignore[arg-type]


def test_settings_that_wear_the_eeprom_are_written_once(tmp_path: Path) -> None:
    with _bench(tmp_path) as (board, _, port):
        for _ in range(3):
            with _connected(port):
                pass
        assert board.settings[1] == 255
        assert board.settings[100] == pytest.approx(80.0 / 9.0)
        # $1, $100, $110 and $120; $32 was right.
        assert board.settings.writes == 4


def test_no_cr_is_sent_because_it_would_be_answered_as_a_line_of_its_own(tmp_path: Path) -> None:
    with _bench(tmp_path) as (_, _, port), _connected(port) as table:
        sent: list[bytes] = []
        table._link.transcript = lambda way, data: sent.append(data) if way == ">" else None
        table.move_to(10.0)
        table.set_laser(1, True)
        assert sent
        assert not any(b"\r" in data for data in sent)


def test_a_hold_by_another_hand_swallows_no_move(tmp_path: Path) -> None:
    with _bench(tmp_path) as (board, emulator, port), _connected(port) as table:
        table.talk("!")
        wait_until(lambda: board.state is State.HOLD)
        table.connect()
        reached = table.move_to(20.0)
        assert plant_state(emulator).angle_deg == pytest.approx(reached, abs=0.01)


def test_the_board_at_another_rate_is_not_spoken_to(tmp_path: Path) -> None:
    with _bench(tmp_path) as (board, emulator, port):
        heard: list[int] = []
        take = board.on_byte

        def listening(byte: int) -> bool:
            heard.append(byte)
            return take(byte)

        board.on_byte = listening  # type: ignore[method-assign]
        table = GrblTable(port, baud=57600)
        with pytest.raises(DeviceUnrecognised, match="not at 57600 baud"):
            table.connect()
        assert not table.is_connected
        assert not heard
        assert not plant_state(emulator).outputs_on


def test_settings_are_written_alone_so_that_no_byte_after_them_is_lost(tmp_path: Path) -> None:
    with _bench(tmp_path) as (board, _, port), _connected(port):
        assert board.settings.writes == 4
        assert board.lost_bytes == 0


def test_a_board_in_laser_mode_lights_while_it_stands(tmp_path: Path) -> None:
    with _bench(tmp_path) as (board, emulator, port):
        board.settings.write(32, 1.0)
        with _connected(port) as table:
            table.set_laser(1, True)
            assert plant_state(emulator).outputs_on == {SPINDLE}
            assert board.settings[32] == 0


def test_the_motor_holds_the_table_after_a_move(tmp_path: Path) -> None:
    with _bench(tmp_path) as (_, emulator, port), _connected(port) as table:
        table.move_to(10.0)
        wait_until(lambda: not plant_state(emulator).is_moving)
        standing_s = emulator.clock.now_s()
        wait_until(lambda: emulator.clock.now_s() > standing_s + 0.5)
        assert plant_state(emulator).is_holding


def test_the_motor_is_let_go_and_taken_again_with_the_count_kept(tmp_path: Path) -> None:
    with _bench(tmp_path) as (board, emulator, port), _connected(port) as table:
        reached = table.move_to(30.0)
        table.hold(False)
        wait_until(lambda: not plant_state(emulator).is_holding)
        assert board.state is State.SLEEP
        table.hold(True)
        wait_until(lambda: plant_state(emulator).is_holding)
        assert table.angle_deg == reached
        again = table.move_to(60.0)
        assert plant_state(emulator).angle_deg == pytest.approx(again, abs=0.01)


def test_a_fresh_board_gets_current_before_its_first_move(tmp_path: Path) -> None:
    with _bench(tmp_path) as (_, emulator, port), _connected(port) as table:
        table.hold(True)
        wait_until(lambda: plant_state(emulator).is_holding)


def test_stopping_ends_without_alarm_and_with_the_exact_count(tmp_path: Path) -> None:
    with _bench(tmp_path) as (board, emulator, port), _connected(port) as table:
        said = _transcript(table)
        error = _in_thread(lambda: table.move_to(300.0))
        wait_until(lambda: plant_state(emulator).angle_deg > 20.0)
        stood = table.stop()
        assert isinstance(error(), MoveStopped)
        assert b"ALARM" not in said()
        assert plant_state(emulator).angle_deg == pytest.approx(stood, abs=1e-3)
        assert board.state is State.IDLE


def test_a_limit_switch_in_mid_move_is_told_and_the_table_goes_on_from_where_it_stands(
    tmp_path: Path,
) -> None:
    with _bench(tmp_path) as (board, emulator, port), _connected(port) as table:
        board.settings.write(21, 1.0)
        error = _in_thread(lambda: table.move_to(300.0))
        wait_until(lambda: plant_state(emulator).angle_deg > 20.0)
        with emulator._lock:
            board.trip_limit(emulator.clock.now_s())
        told = error()
        assert isinstance(told, DeviceError)
        assert "limit switch" in told.message
        assert table.angle_deg == pytest.approx(plant_state(emulator).angle_deg, abs=0.01)
        reached = table.move_to(0.0)
        assert plant_state(emulator).angle_deg == pytest.approx(reached, abs=0.01)


def test_an_alarm_that_nobody_saw_is_cleared_at_the_next_command(tmp_path: Path) -> None:
    with _bench(tmp_path) as (board, emulator, port), _connected(port) as table:
        board.settings.write(21, 1.0)
        with emulator._lock:
            board.trip_limit(emulator.clock.now_s())
        table.set_laser(1, True)
        assert plant_state(emulator).outputs_on == {SPINDLE}


def test_a_reset_while_it_stands_keeps_the_angle_and_lights_the_laser_again(tmp_path: Path) -> None:
    with _bench(tmp_path) as (_, emulator, port), _connected(port) as table:
        table.move_to(40.0)
        table.set_laser(2, True)
        emulator.reset()
        wait_until(lambda: not plant_state(emulator).outputs_on)
        reached = table.move_to(80.0)
        assert reached == pytest.approx(80.0, abs=0.06)
        assert plant_state(emulator).angle_deg == pytest.approx(reached, abs=0.12)
        assert plant_state(emulator).outputs_on == {COOLANT}


def test_a_reset_in_mid_move_leaves_the_position_unknown(tmp_path: Path) -> None:
    with _bench(tmp_path) as (_, emulator, port), _connected(port) as table:
        error = _in_thread(lambda: table.move_to(300.0))
        wait_until(lambda: plant_state(emulator).angle_deg > 20.0)
        emulator.reset()
        told = error()
        assert isinstance(told, PositionUnknown)
        true = plant_state(emulator).angle_deg
        assert told.lowest_deg <= true <= told.highest_deg
        table.zero(true)
        reached = table.move_to(true + 10.0)
        assert plant_state(emulator).angle_deg == pytest.approx(reached, abs=0.12)


def test_a_board_that_does_not_reset_is_found_where_it_is_and_put_in_the_dark(tmp_path: Path) -> None:
    with _bench(tmp_path, resets_on_open=False) as (board, emulator, port):
        with emulator._lock:
            board.receive(b"M3 S1000\nM8\n", emulator.clock.now_s() + 2.0)
        wait_until(lambda: len(plant_state(emulator).outputs_on) == 2)
        with _connected(port) as table:
            assert not plant_state(emulator).outputs_on
            reached = table.move_to(25.0)
            assert plant_state(emulator).angle_deg == pytest.approx(reached, abs=0.01)


def test_a_board_that_starts_locked_is_unlocked(tmp_path: Path) -> None:
    with _bench(tmp_path) as (board, emulator, port):
        board.settings.write(22, 1.0)
        with _connected(port) as table:
            reached = table.move_to(15.0)
            assert plant_state(emulator).angle_deg == pytest.approx(reached, abs=0.01)


def test_the_first_start_of_a_board_with_a_blank_eeprom_is_no_error(tmp_path: Path) -> None:
    board = Grbl(Plant(Wiring(3200.0)), is_blank=True)
    with _bench(tmp_path, board=board) as (_, emulator, port), _connected(port) as table:
        reached = table.move_to(15.0)
        assert plant_state(emulator).angle_deg == pytest.approx(reached, abs=0.01)


def test_positions_are_understood_in_work_coordinates_with_an_offset_that_comes_seldom(
    tmp_path: Path,
) -> None:
    with _bench(tmp_path) as (board, emulator, port):
        board.settings.write(10, 0.0)
        with _connected(port) as table:
            table.talk("G92 X100")
            for angle in (10.0, 20.0, 5.0):
                reached = table.move_to(angle)
                assert reached == pytest.approx(angle, abs=0.06)
                assert plant_state(emulator).angle_deg == pytest.approx(reached, abs=0.01)


def test_the_table_may_be_on_another_axis_but_on_one_that_exists(tmp_path: Path) -> None:
    board = Grbl(Plant(Wiring(3200.0)), table_axis="Y")
    with _bench(tmp_path, board=board) as (_, emulator, port):
        with _connected(port, axis="Y") as table:
            reached = table.move_to(33.0)
            assert plant_state(emulator).angle_deg == pytest.approx(reached, abs=0.01)
        with pytest.raises(DeviceRefused, match="no axis A"):
            GrblTable(port, axis="A").connect()


def test_slower_than_the_timer_can_count_is_refused(tmp_path: Path) -> None:
    with _bench(tmp_path) as (_, _, port):
        with _connected(port) as table:
            assert table.facts.slowest_deg_s == pytest.approx(30.5 / (80.0 / 9.0))
            with pytest.raises(DeviceRefused, match="cannot turn at 2"):
                table.start_turning(10.0, 2.0)
        with pytest.raises(DeviceRefused) as told:
            GrblTable(port, steps_per_deg=80.0 / 9.0, speed_deg_s=1.0).connect()
        assert "speed_deg_s" in told.value.hint


def test_the_angle_is_told_while_the_table_turns(tmp_path: Path) -> None:
    with _bench(tmp_path) as (_, emulator, port), _connected(port) as table:
        table.start_turning(180.0, 60.0)
        wait_until(lambda: plant_state(emulator).angle_deg > 20.0)
        before = plant_state(emulator).angle_deg
        told = table.position_now()
        assert told is not None
        assert before - 0.2 <= told <= plant_state(emulator).angle_deg + 0.2
        assert table.finish_turning() == pytest.approx(180.0, abs=0.06)


def test_a_steady_turn_that_is_stopped_says_so(tmp_path: Path) -> None:
    with _bench(tmp_path) as (_, emulator, port), _connected(port) as table:
        table.start_turning(300.0, 30.0)
        wait_until(lambda: plant_state(emulator).angle_deg > 20.0)
        error = _in_thread(table.finish_turning)
        stood = table.stop()
        assert isinstance(error(), MoveStopped)
        assert stood < 200.0
        assert plant_state(emulator).angle_deg == pytest.approx(stood, abs=0.01)


def test_the_farewell_makes_a_moving_board_dark_and_slack(tmp_path: Path) -> None:
    with _bench(tmp_path, resets_on_open=False) as (_, emulator, port):
        with _connected(port) as table:
            table.set_laser(1, True)
            table.start_turning(300.0, 20.0)
            wait_until(lambda: plant_state(emulator).angle_deg > 5.0)
            farewell = table.farewell
            assert farewell is not None
            table._link.close()
        with serial.serial_for_url(farewell.port, farewell.baud) as line:
            for word, wait_s in farewell.words:
                line.write(word)
                until_s = emulator.clock.now_s() + wait_s
                wait_until(lambda until_s=until_s: emulator.clock.now_s() > until_s)  # type: ignore[misc]
        state = plant_state(emulator)
        assert not state.outputs_on
        assert not state.is_moving
        assert not state.is_holding


def test_an_error_does_not_shift_the_answers_by_one(tmp_path: Path) -> None:
    with _bench(tmp_path) as (_, emulator, port), _connected(port) as table:
        with pytest.raises(DeviceRefused, match="error 20"):
            table.talk("M71T1")
        assert "[GC:" in table.talk("$G")
        reached = table.move_to(12.0)
        assert plant_state(emulator).angle_deg == pytest.approx(reached, abs=0.01)


def test_status_fields_may_stand_in_any_order() -> None:
    status = parse_status("Hold:1|Bf:35,1023|FS:0,0|H:0|MPos:1.5,0.000,-2.25|TLR:0|Junk|A:SF")
    assert (status.state, status.detail, status.machine) == ("Hold", "1", (1.5, 0.0, -2.25))
    assert status.is_moving
    assert parse_status("Idle|MPos:x,y").machine == ()


@pytest.mark.parametrize("options", [{"axis": "Q"}, {"steps_per_deg": -1.0}, {"laser_power": float("nan")}])
def test_options_that_make_no_sense_are_refused(options: dict[str, object]) -> None:
    with pytest.raises(OptionError):
        GrblTable("nowhere", **options)  # type: ignore[arg-type]


def test_a_dead_port_is_no_grbl_board(tmp_path: Path) -> None:
    link = SerialLink(str(tmp_path / "port"), 115200, "turntable")
    with _bench(tmp_path, resets_on_open=False) as (_, emulator, _):
        emulator.silence(1000.0)
        link.open()
        try:
            with pytest.raises(DeviceUnrecognised, match="no Grbl board"):
                GrblDialogue(link).greet()
        finally:
            link.close()


@contextmanager
def _bench(
    folder: Path, *, board: Grbl | None = None, resets_on_open: bool = True
) -> Iterator[tuple[Grbl, EmulatedPort, str]]:
    board = board or Grbl(Plant(Wiring(3200.0)))
    with EmulatedPort(board, folder / "port", Clock(10.0), resets_on_open=resets_on_open) as emulator:
        yield board, emulator, str(emulator.link)


@contextmanager
def _connected(port: str, **options: object) -> Iterator[GrblTable]:
    table = GrblTable(port, **{**_OPTIONS, **options})  # type: ignore[arg-type]
    table.connect()
    try:
        yield table
    finally:
        table.disconnect()


def _transcript(table: GrblTable) -> Callable[[], bytes]:
    heard = bytearray()
    table._link.transcript = lambda way, data: heard.extend(data) if way == "<" else None
    return lambda: bytes(heard)


def _in_thread(action: Callable[[], object]) -> Callable[[], DeviceError | None]:
    """Start something; the result waits for its end and gives its error."""
    errors: list[DeviceError] = []

    def run() -> None:
        try:
            action()
        except DeviceError as error:
            errors.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()

    def result() -> DeviceError | None:
        thread.join(20.0)
        assert not thread.is_alive(), "it never ended"
        return errors[0] if errors else None

    return result
