"""The simulated Sardauscan does what its sources say."""

import math

import pytest

from app.simulation.firmware.dialects.sardauscan import Sardauscan
from app.simulation.firmware.plant import Plant, Wiring


@pytest.fixture
def board() -> Sardauscan:
    """One that has started and said its banner."""
    firmware = Sardauscan(Plant(Wiring(Sardauscan.steps_per_turn)))
    firmware.reset(0.0)
    firmware.advance(1.5)
    assert firmware.sent() == b"Sardauscan V0.1a\r\n"
    return firmware


def answer(board: Sardauscan, request: bytes, wait_s: float = 20.0) -> bytes:
    board.receive(request, board.now_s)
    board.advance(board.now_s + wait_s)
    return board.sent()


@pytest.mark.parametrize(
    ("request_", "reply"),
    [
        (b"sardauscan\r", b"yes\r\n"),
        (b"sardauscan\r\n", b"yes\r\n"),
        (b"sardauscan\n", b""),
        (b"\r", b""),
        (b"L\r", b"LASER_COUNT: 4\r\n"),
        (b"L 1 1\r", b"SET_LASER: 1(15) = 1\r\n"),
        (b"L 1\r", b"LASER_STATE: 1(15) = 0\r\n"),
        (b"L 9 1\r", b"SET_LASER: 9(-1) = 0\r\n"),
        (b"T S\r", b"REVOLUTION STEPS  => 1018\r\n"),
        (b"T\r", b"Position 0\r\n"),
        (b"t r 10\r", b"RELATIVE ROTATION :10 => 10\r\n"),
        (b"T A -10\r", b"ABSOLUTE ROTATION -10 => -10\r\n"),
        (b"T Q\r", b"Unknown Table command :Q\r\n"),
        (b"M115\r", b"Hun?\r\n"),
        (b"SARDAUSCAN\r", b"Hun?\r\n"),
        # The buffer has sixteen places and begins anew.
        (b"x" * 16 + b"L\r", b"LASER_COUNT: 4\r\n"),
    ],
)
def test_each_request_has_its_reply(board: Sardauscan, request_: bytes, reply: bytes) -> None:
    assert answer(board, request_) == reply


def test_a_turn_takes_the_ramps_of_the_setup_and_is_answered_at_its_end(board: Sardauscan) -> None:
    began = board.now_s
    board.receive(b"T R 1018\r", began)
    board.advance(began + 30.0)
    ended = board.sent_with_times()[0][0]
    assert ended - began == pytest.approx(4072 / 500 + 500 / 200, abs=0.01)
    assert board.plant.at(board.now_s).angle_deg == pytest.approx(360.0)


def test_commands_wait_until_a_move_is_over(board: Sardauscan) -> None:
    heard = answer(board, b"T R 100\rL 0 1\rT\r")
    assert heard == b"RELATIVE ROTATION :100 => 100\r\nSET_LASER: 0(14) = 1\r\nPosition 100\r\n"
    move, laser = (event for event in board.plant.events if event.what in ("move", "laser on"))
    assert laser.time_s - move.time_s > 2.0


def test_sixteen_bits_turn_a_great_move_round(board: Sardauscan) -> None:
    answer(board, b"T R 8192\r", 100.0)
    assert board.plant.at(board.now_s).angle_deg < 0.0


def test_setting_zero_turns_nothing(board: Sardauscan) -> None:
    answer(board, b"T A 20\r")
    assert answer(board, b"T C\r") == b"RESET CUTTENT POSITION  => 0\r\n"
    assert answer(board, b"T\r") == b"Position 0\r\n"
    assert board.plant.at(board.now_s).angle_deg == pytest.approx(360.0 * 20 / 1018)


def test_a_reset_stops_the_table_and_puts_the_lasers_out(board: Sardauscan) -> None:
    answer(board, b"L 2 1\r")
    answer(board, b"T R 500\r", 2.0)
    at = board.plant.at(board.now_s)
    assert at.is_moving
    assert at.outputs_on == {2}
    board.reset(board.now_s)
    board.advance(board.now_s + 5.0)
    after = board.plant.at(board.now_s)
    assert after.angle_deg == pytest.approx(at.angle_deg)
    assert not after.outputs_on
    assert not after.is_holding
    assert board.sent() == b"Sardauscan V0.1a\r\n"
    assert board.due_s == math.inf
