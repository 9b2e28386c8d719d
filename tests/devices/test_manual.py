"""Tables without a board: turned by a person, or by themselves."""

import threading
import time

import pytest

from app.devices.turntable import TURNTABLES, Turntable
from app.devices.turntables.manual import ManualTurntable
from app.errors import DeviceError, DeviceRefused, MoveStopped


def test_a_person_is_asked_for_each_stop_and_the_angle_is_what_was_confirmed() -> None:
    asked: list[str] = []
    table: Turntable = TURNTABLES.make("manual", ask=asked.append)
    table.connect()
    assert table.move_to(29.6) == 30.0
    assert table.angle_deg == 30.0
    assert asked == ["Turn the table to 30 degrees, then confirm."]
    table.move_to(30.2)
    assert len(asked) == 1


def test_a_person_who_gives_up_leaves_the_angle_as_it_was() -> None:
    def give_up(what: str) -> None:
        raise KeyboardInterrupt(what)

    table = ManualTurntable(ask=give_up)
    table.connect()
    with pytest.raises(KeyboardInterrupt):
        table.move_to(30.0)
    assert table.angle_deg == 0.0


def test_a_stop_while_the_person_turns_ends_the_move_where_it_was_confirmed() -> None:
    table = ManualTurntable()
    table.ask = lambda what: _ignore(table.stop())
    table.connect()
    with pytest.raises(MoveStopped):
        table.move_to(40.0)
    assert table.angle_deg == 40.0
    table.ask = lambda what: None
    assert table.move_to(50.0) == 50.0


def test_lasers_are_switched_by_the_same_person_and_only_when_needed() -> None:
    asked: list[str] = []
    table = ManualTurntable(ask=asked.append)
    table.connect()
    for is_on in (True, True, False):
        table.set_laser(2, is_on)
    assert asked == ["Switch laser 2 on, then confirm.", "Switch laser 2 off, then confirm."]
    with pytest.raises(DeviceRefused, match="no laser 3"):
        table.set_laser(3, True)


def test_lasers_that_are_always_on_need_nobody() -> None:
    table = ManualTurntable(laser_channels=(1,), are_lasers_always_on=True)
    table.connect()
    table.set_laser(1, True)
    table.set_laser(1, False)
    with pytest.raises(DeviceRefused):
        table.set_laser(2, True)


def test_without_a_person_nothing_moves() -> None:
    table = ManualTurntable()
    table.connect()
    with pytest.raises(DeviceError, match="nobody to ask"):
        table.move_to(10.0)
    with pytest.raises(DeviceRefused, match="by hand"):
        table.start_turning(360.0, 10.0)


def test_a_table_that_turns_by_itself_tells_its_angle_by_the_time() -> None:
    table = ManualTurntable(seconds_per_turn=1.8)
    table.connect()
    assert table.facts.fastest_deg_s == pytest.approx(200.0)
    turn = table.start_turning(20.0, 5.0)
    assert turn.speed_deg_s == pytest.approx(200.0)
    assert turn.duration_s == pytest.approx(0.1)
    assert turn.to_deg - turn.from_deg == pytest.approx(20.0)
    reached = table.finish_turning()
    passed_s = time.monotonic() - turn.started_s
    assert turn.to_deg - 0.5 <= reached <= turn.from_deg + 200.0 * passed_s + 0.5
    assert table.position_now() is not None
    with pytest.raises(DeviceRefused, match="by itself"):
        table.move_to(90.0)


def test_a_clockwise_table_counts_down() -> None:
    table = ManualTurntable(seconds_per_turn=-3.6)
    table.connect()
    turn = table.start_turning(36.0, 10.0)
    assert turn.to_deg - turn.from_deg == pytest.approx(-36.0)
    assert table.finish_turning() < -30.0


def test_whoever_waits_for_a_long_turn_can_be_called_off() -> None:
    table = ManualTurntable(seconds_per_turn=1000.0)
    table.connect()
    table.start_turning(360.0, 1.0)
    caller = threading.Timer(0.05, table.make_safe)
    caller.start()
    with pytest.raises(MoveStopped):
        table.finish_turning()
    caller.join()


def test_zero_names_the_place_that_passes_now() -> None:
    table = ManualTurntable(seconds_per_turn=3600.0)
    table.connect()
    table.zero(90.0)
    assert table.angle_deg == pytest.approx(90.0, abs=1.0)


@pytest.mark.parametrize("options", [{"seconds_per_turn": float("nan")}, {"smallest_deg": 0.0}])
def test_options_without_sense_are_refused(options: dict[str, float]) -> None:
    with pytest.raises(DeviceRefused):
        ManualTurntable(**options)  # type: ignore[arg-type]


def _ignore(angle_deg: float) -> None:
    del angle_deg
