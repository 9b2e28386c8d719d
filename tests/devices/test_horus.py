"""The Horus driver against its boards: the contract, and each trap that the boards have laid."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from turntable_contract import TurntableContract, _Move, plant_state, wait_until

from app.devices.horus_kind import CloneHorus, true_horus
from app.devices.turntable import Turntable
from app.devices.turntables.horus import HorusTable
from app.errors import DeviceRefused, DeviceTimeout, DeviceUnrecognised, MoveStopped, PositionUnknown
from app.simulation.clock import Clock
from app.simulation.firmware.dialects.horus import Horus
from app.simulation.firmware.dialects.horus_0_1 import HorusFirst
from app.simulation.firmware.dialects.horus_clone import HorusClone
from app.simulation.firmware.kernel import Firmware
from app.simulation.firmware.plant import Plant, Wiring
from app.simulation.firmware.port import EmulatedPort

Plug = Callable[..., EmulatedPort]


@pytest.fixture(autouse=True)
def _less_patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """The emulated world runs ten times as fast."""
    monkeypatch.setattr("app.devices.horus_recognition._BOOT_S", 0.8)
    monkeypatch.setattr("app.devices.horus_line._BANNER_S", 0.8)


class TestHorus(TurntableContract):
    def make_firmware(self, plant: Plant) -> Firmware:
        return Horus(plant)

    def make_driver(self, port: str) -> Turntable:
        return HorusTable(port)


class TestHorusClone(TurntableContract):
    steps_per_turn = HorusClone.steps_per_turn

    def make_firmware(self, plant: Plant) -> Firmware:
        return HorusClone(plant)

    def make_driver(self, port: str) -> Turntable:
        return HorusTable(port)


class Stranger(Firmware):
    """A board that says something else."""

    words = "\r\nGrbl 1.1h ['$' for help]\r\n"

    def on_reset(self) -> None:
        pass

    def program(self) -> Iterator[float]:
        self.say(self.words)
        while True:
            yield from self.read_byte()


class Mute(Stranger):
    words = ""


@pytest.fixture
def plug(tmp_path: Path) -> Iterator[Plug]:
    """Puts a board on a port, in a world that runs faster."""
    ports: list[EmulatedPort] = []

    def plug(board: Callable[[Plant], Firmware] = Horus, rate: float = 10.0, **options: bool) -> EmulatedPort:
        steps = 2048.0 if board is HorusClone else 3200.0
        port = EmulatedPort(board(Plant(Wiring(steps))), tmp_path / "port", Clock(rate), **options)
        ports.append(port)
        return port

    yield plug
    for port in ports:
        port.close()


@contextmanager
def connected(port: EmulatedPort, **options: float) -> Iterator[HorusTable]:
    table = HorusTable(str(port.link), **options)  # type: ignore[arg-type]
    try:
        table.connect()
        yield table
    finally:
        table.disconnect()
        # The emulator looks now and then whether its port is open; opened again at once it would not reset.
        time.sleep(0.05)


def test_a_board_with_a_blank_eeprom_is_met(plug: Plug) -> None:
    with connected(plug(lambda plant: Horus(plant, is_blank=True))) as table:
        assert table.facts.firmware == "Horus 0.2"
        assert table.facts.smallest_deg == pytest.approx(360.0 / 3200.0)


def test_version_0_1_turns_without_g50(plug: Plug) -> None:
    port = plug(HorusFirst)
    with connected(port) as table:
        assert table.facts.firmware == "Horus 0.1"
        table.zero(100.0)
        assert table.move_to(190.0) == pytest.approx(190.0)
        assert plant_state(port).angle_deg == pytest.approx(90.0)


def test_the_clone_is_known_by_what_it_does_not_say(plug: Plug) -> None:
    port = plug(HorusClone)
    with connected(port) as table:
        assert "clone" in table.facts.firmware
        assert not table.facts.can_turn_steadily
        with pytest.raises(DeviceRefused, match="its own speed"):
            table.start_turning(90.0, 20.0)


def test_a_board_that_another_program_left_turning_and_lit_is_stopped_where_it_is(plug: Plug) -> None:
    port = plug(resets_on_open=False)
    wait_until(lambda: port.firmware.due_s == float("inf"))
    port.firmware.receive(b"M71T2\nG1F20X1500\n", port.clock.now_s())
    wait_until(lambda: plant_state(port).angle_deg > 10.0)
    with connected(port) as table:
        state = plant_state(port)
        assert not state.is_moving
        assert not state.outputs_on
        assert state.angle_deg < 1400.0
        assert table.facts.firmware == "Horus 0.2"
        table.zero(state.angle_deg)
        reached = table.move_to(state.angle_deg + 20.0)
        assert plant_state(port).angle_deg == pytest.approx(reached, abs=0.06)


def test_a_clone_that_does_not_reset_is_asked(plug: Plug) -> None:
    port = plug(HorusClone, resets_on_open=False)
    wait_until(lambda: port.firmware.due_s == float("inf"))
    with connected(port) as table:
        assert "clone" in table.facts.firmware


def test_a_board_that_starts_locked_is_unlocked(plug: Plug) -> None:
    port = plug()
    with connected(port) as table:
        assert "ok" in table.talk("$22=1")
    with connected(port) as table:
        table.set_laser(1, True)
        assert plant_state(port).outputs_on == {0}
        assert table.move_to(9.0) == 9.0


def test_a_lock_in_mid_work_is_undone(plug: Plug) -> None:
    port = plug()
    with connected(port) as table:
        table.talk("$22=1")
        table.move_to(9.0)
        port.reset()
        time.sleep(0.2)
        table.set_laser(2, True)
        assert plant_state(port).outputs_on == {1}


def test_a_board_that_resets_itself_at_rest_goes_on_where_it_stood(plug: Plug) -> None:
    port = plug()
    with connected(port) as table:
        table.move_to(45.0)
        table.set_laser(1, True)
        port.reset()
        time.sleep(0.2)
        assert not plant_state(port).outputs_on
        assert table.move_to(90.0) == 90.0
        assert plant_state(port).angle_deg == pytest.approx(90.0)
        assert plant_state(port).outputs_on == {0}


@pytest.mark.parametrize("board", [Horus, HorusClone])
def test_a_board_that_is_asked_while_it_boots_is_known_to_have_restarted(
    plug: Plug, board: type[Firmware]
) -> None:
    port = plug(board)
    with connected(port) as table:
        stood = table.move_to(36.0)
        port.reset()
        table.connect()
        assert table.angle_deg == stood
        reached = table.move_to(54.0)
        assert plant_state(port).angle_deg == pytest.approx(reached, abs=1e-6)


@pytest.mark.parametrize("board", [Horus, HorusClone])
def test_a_board_that_resets_itself_in_mid_move_does_not_know_where_it_is(
    plug: Plug, board: type[Firmware]
) -> None:
    port = plug(board)
    with connected(port) as table:
        mover = _Move(table, 300.0)
        wait_until(lambda: plant_state(port).angle_deg > 30.0)
        port.reset()
        mover.join()
        assert isinstance(mover.error, PositionUnknown)
        true = plant_state(port).angle_deg
        assert mover.error.lowest_deg - 1.0 <= true <= mover.error.highest_deg + 1.0
        table.zero(true)
        reached = table.move_to(true + 20.0)
        assert plant_state(port).angle_deg == pytest.approx(reached, abs=0.1)


def test_an_idle_laser_outlives_the_timer(plug: Plug) -> None:
    port = plug(rate=150.0)
    with connected(port, rearm_s=1.0) as table:
        table.set_laser(1, True)
        lit_at_s = port.clock.now_s()
        wait_until(lambda: port.clock.now_s() > lit_at_s + 300.0)
        wait_until(lambda: plant_state(port).outputs_on == {0})
        went_out = [event for event in port.firmware.plant.events if event.what == "laser off"]
        assert 1 <= len(went_out) <= 4


def test_a_laser_outlives_the_timer_in_a_long_move(plug: Plug) -> None:
    port = plug(rate=150.0)
    with connected(port, rearm_s=1.0, speed_deg_s=4.0) as table:
        table.set_laser(2, True)
        table.move_to(1300.0)
        assert plant_state(port).outputs_on == {1}
        moves = [event for event in port.firmware.plant.events if event.what == "move"]
        assert len(moves) > 1
        assert plant_state(port).angle_deg == pytest.approx(1300.0, abs=0.06)


def test_a_steady_turn_longer_than_the_timer_is_refused_with_a_laser_on(plug: Plug) -> None:
    with connected(plug()) as table:
        table.set_laser(1, True)
        with pytest.raises(DeviceRefused, match="puts it out"):
            table.start_turning(1500.0, 4.0)
        table.set_laser(1, False)
        table.start_turning(1500.0, 4.0)
        assert table.stop() < 1000.0


def test_the_eeprom_is_written_only_when_it_differs(plug: Plug) -> None:
    port = plug()
    assert isinstance(port.firmware, Horus)
    eeprom = port.firmware.settings.eeprom
    fresh = eeprom.writes
    for acceleration, writes in ((0.0, 0), (180.0, 0), (90.0, 1), (90.0, 1)):
        with connected(port, acceleration_deg_s2=acceleration) as table:
            table.move_to(3.0)
        assert eeprom.writes == fresh + writes
    assert port.firmware.settings[120] == 90.0


def test_a_stop_raises_no_alarm_and_what_was_lit_stays_lit(plug: Plug) -> None:
    port = plug()
    with connected(port) as table:
        table.set_laser(1, True)
        mover = _Move(table, 300.0)
        wait_until(lambda: plant_state(port).angle_deg > 30.0)
        stood = table.stop()
        mover.join()
        assert isinstance(mover.error, MoveStopped)
        assert plant_state(port).angle_deg == pytest.approx(stood, abs=1e-3)
        assert plant_state(port).outputs_on == {0}
        assert plant_state(port).is_holding
        assert "Idle" in table.talk("?")
        assert table.move_to(0.0) == pytest.approx(0.0, abs=1e-9)
        assert plant_state(port).angle_deg == pytest.approx(0.0, abs=1e-6)


def test_a_stop_at_rest_changes_nothing(plug: Plug) -> None:
    port = plug()
    with connected(port) as table:
        table.move_to(18.0)
        assert table.stop() == 18.0
        assert table.move_to(27.0) == 27.0
        assert plant_state(port).angle_deg == pytest.approx(27.0)


def test_a_speed_that_the_timer_cannot_count_is_refused_in_words(plug: Plug) -> None:
    port = plug()
    with connected(port) as table:
        for speed in (3.0, 181.0):
            with pytest.raises(DeviceRefused, match="cannot turn at") as told:
                table.start_turning(10.0, speed)
            assert "from 3.432 to 180" in told.value.hint
    with pytest.raises(DeviceRefused, match="cannot turn at 2"), connected(port, speed_deg_s=2.0):
        pass


def test_late_answers_are_not_taken_for_those_to_the_next_command(plug: Plug) -> None:
    port = plug()
    with connected(port) as table:
        port.slow(12.0)
        late_s = port.clock.now_s() + 12.5
        with pytest.raises(DeviceTimeout):
            table.set_laser(1, True)
        wait_until(lambda: port.clock.now_s() > late_s)
        table.set_laser(1, False)
        assert not plant_state(port).outputs_on
        assert table.move_to(9.0) == 9.0
        assert plant_state(port).angle_deg == pytest.approx(9.0)


def test_the_motor_holds_the_table_from_the_first_move_until_told(plug: Plug) -> None:
    port = plug()
    with connected(port) as table:
        assert not plant_state(port).is_holding
        table.move_to(9.0)
        assert plant_state(port).is_holding
        table.hold(False)
        wait_until(lambda: not plant_state(port).is_holding)
        table.hold(True)
        table.make_safe()
        wait_until(lambda: not plant_state(port).is_holding)


def test_the_place_can_be_asked_while_another_thread_waits_for_the_end(plug: Plug) -> None:
    port = plug()
    with connected(port) as table:
        turn = table.start_turning(180.0, 10.0)
        assert turn.to_deg == pytest.approx(180.0)
        first = table.position_now()
        waiter = threading.Thread(target=table.finish_turning)
        waiter.start()
        wait_until(lambda: plant_state(port).angle_deg > 60.0)
        second = table.position_now()
        waiter.join()
        assert first is not None
        assert second is not None
        assert 0.0 <= first < 60.0 <= second + 0.2 < 180.2
        assert table.angle_deg == pytest.approx(180.0)


def test_the_end_of_a_turn_that_comes_before_anybody_waits_is_not_lost(plug: Plug) -> None:
    port = plug()
    with connected(port) as table:
        table.start_turning(20.0, 20.0)
        wait_until(lambda: plant_state(port).angle_deg > 19.99)
        time.sleep(0.05)
        assert table.position_now() == pytest.approx(20.0, abs=0.06)
        assert table.finish_turning() == pytest.approx(20.0, abs=0.06)


def test_a_clone_is_stopped_between_the_pieces_of_a_move(plug: Plug) -> None:
    port = plug(HorusClone)
    with connected(port) as table:
        mover = _Move(table, 300.0)
        wait_until(lambda: plant_state(port).angle_deg > 30.0)
        stood = table.stop()
        mover.join()
        assert isinstance(mover.error, MoveStopped)
        assert stood < 90.0
        assert plant_state(port).angle_deg == pytest.approx(stood, abs=1e-6)


def test_a_clone_that_was_not_heard_counts_anew_where_it_is_said_to_stand(plug: Plug) -> None:
    port = plug(HorusClone)
    with connected(port) as table:
        table.move_to(9.0)
        port.silence(600.0)
        with pytest.raises(DeviceTimeout):
            table.move_to(25.0)
        port.silence(0.0)
        with pytest.raises(PositionUnknown):
            table.connect()
        table.zero(25.0)
        start = plant_state(port).angle_deg
        turned = table.move_to(40.0) - 25.0
        assert plant_state(port).angle_deg - start == pytest.approx(turned)


def test_a_clone_counts_anew_before_its_16_bits_overflow(plug: Plug) -> None:
    port = plug(HorusClone, rate=500.0)
    with connected(port) as table:
        reached = table.move_to(5900.0)
        assert reached == pytest.approx(5900.0, abs=0.75)
        assert plant_state(port).angle_deg == pytest.approx(reached, abs=1e-6)


def test_places_of_a_clone_are_those_that_whole_degrees_give() -> None:
    clone = CloneHorus()
    for asked in (-200.3, -1.0, 0.0, 0.4, 1.9, 45.0, 359.6):
        place = clone.reached(asked)
        degrees = int(clone.line(place, 0.0).removeprefix("G1X"))
        assert int(degrees * 512 / 360) * 360.0 / 512 == place
        assert abs(place - asked) <= 0.5 * clone.smallest_deg + 1e-9


def test_three_decimals_of_a_setting_mean_a_whole_number_of_steps_in_a_turn() -> None:
    assert true_horus("", {100: 8.889}).steps_per_deg == 3200.0 / 360.0
    assert true_horus("", {100: 4.444}).steps_per_deg == 1600.0 / 360.0
    assert true_horus("", {100: 7.3017}).steps_per_deg == 7.3017


def test_other_boards_are_told_apart(plug: Plug) -> None:
    with pytest.raises(DeviceUnrecognised, match="Grbl"), connected(plug(Stranger)):
        pass


def test_a_port_where_nothing_answers_is_no_horus(plug: Plug) -> None:
    with pytest.raises(DeviceUnrecognised, match="nothing"), connected(plug(Mute)):
        pass


def test_what_a_person_types_is_answered_and_taken_into_account(plug: Plug) -> None:
    port = plug()
    with connected(port) as table:
        assert "[0.2:]" in table.talk("$I")
        assert "error: Unsupported command" in table.talk("G28")
        table.talk("M71 T2")
        assert plant_state(port).outputs_on == {1}
        table.make_safe()
        assert not plant_state(port).outputs_on
