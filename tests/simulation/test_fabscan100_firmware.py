"""The simulated FabScan100 does what its sources say."""

import pytest

from app.simulation.firmware.dialects.fabscan100 import FabScan100
from app.simulation.firmware.plant import Plant, Wiring


@pytest.fixture
def board() -> FabScan100:
    """One that has started."""
    firmware = FabScan100(Plant(Wiring(3200.0)))
    firmware.reset(0.0)
    firmware.advance(1.5)
    return firmware


def tell(board: FabScan100, *codes: int, wait_s: float = 5.0) -> bytes:
    board.receive(bytes(codes), board.now_s)
    board.advance(board.now_s + wait_s)
    return board.sent()


def test_it_says_211_when_the_boot_loader_is_over_and_its_laser_is_on(board: FabScan100) -> None:
    said = board.sent_with_times()
    assert [byte for _, byte in said] == [211]
    assert said[0][0] == pytest.approx(1.001, abs=0.001)
    assert board.plant.at(0.9).outputs_on == frozenset()
    assert board.plant.at(1.1).outputs_on == {0}


def test_the_laser_is_switched_without_an_answer(board: FabScan100) -> None:
    board.sent()
    assert tell(board, 200) == b""
    assert not board.plant.at(board.now_s).outputs_on
    assert tell(board, 201) == b""
    assert board.plant.at(board.now_s).outputs_on == {0}


def test_a_ping_is_answered_behind_the_steps_at_six_milliseconds_each(board: FabScan100) -> None:
    board.sent()
    began = board.now_s
    board.receive(bytes([205, 204, 202, 100, 210]), began)
    board.advance(began + 5.0)
    (answered, byte), *more = board.sent_with_times()
    assert (byte, more) == (211, [])
    # Five bytes in, one out, and the firmware's millisecond.
    assert answered - began == pytest.approx(0.6 + 0.004 + 0.002, abs=0.002)
    assert board.plant.at(board.now_s).angle_deg == pytest.approx(360.0 * 100 / 3200)


def test_203_turns_the_other_way(board: FabScan100) -> None:
    tell(board, 205, 203, 202, 80)
    assert board.plant.at(board.now_s).angle_deg == pytest.approx(-9.0)


def test_without_current_the_steps_turn_nothing(board: FabScan100) -> None:
    tell(board, 202, 80)
    assert board.plant.at(board.now_s).angle_deg == 0.0
    tell(board, 205, 206, 202, 80)
    assert board.plant.at(board.now_s).angle_deg == 0.0


def test_another_stepper_leaves_the_table_alone(board: FabScan100) -> None:
    board.sent()
    assert tell(board, 205, 212, 11, 202, 80) == b"\x0b"
    assert board.plant.at(board.now_s).angle_deg == 0.0
    assert tell(board, 212, 10, 202, 80) == b"\x0a"
    assert board.plant.at(board.now_s).angle_deg == pytest.approx(9.0)


def test_after_209_nothing_is_answered_until_a_reset(board: FabScan100) -> None:
    board.sent()
    assert tell(board, 209, 210, 210) == b""
    board.reset(board.now_s)
    board.advance(board.now_s + 1.5)
    assert board.sent() == b"\xd3"
    assert tell(board, 210) == b"\xd3"


def test_text_does_nothing_but_what_follows_202_is_a_number_of_steps(board: FabScan100) -> None:
    board.sent()
    assert tell(board, *b"M115\r\n?$I\n") == b""
    assert not [event for event in board.plant.events if event.what == "move"]
    tell(board, 205, 202, *b"A")
    assert board.plant.at(board.now_s).angle_deg == pytest.approx(360.0 * 65 / 3200)
