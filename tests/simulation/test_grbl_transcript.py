"""The emulated Grbl board says and does what the recorded one did, and grblHAL what is known of it."""

import dataclasses

import pytest
from transcripts import Played, Player, Row, Setting, Tolerance, read_transcript

from app.simulation.firmware.dialects.grbl import Grbl
from app.simulation.firmware.dialects.grblhal import GrblHal
from app.simulation.firmware.grbl_machine import COOLANT, SPINDLE
from app.simulation.firmware.plant import Plant, Wiring

# What surrounded a row and its table tells in a note or not at all: by text, and which of that text.
_SETTINGS = {
    ("G1 F500 X2␊", 0): Setting(quiet_s=0.5728),
    ("G4 P0␊", 1): Setting(before=((b"G1 F500 X3\n", 0.0025),)),
    ("!", 0): Setting(before=((b"G1 F500 X5\n", 0.3950),), quiet_s=1.2),
    ("~", 0): Setting(quiet_s=1.6),
    ("~", 1): Setting(quiet_s=1.0),
    ("\\x18", 1): Setting(before=((b"M3 S1000\n", 0.01), (b"G1 F500 X5\n", 0.3952))),
    ("G1X1F100␊", 1): Setting(quiet_s=1.0),
}
_BOOT = Setting(quiet_s=1.3)
# The whole way of a move stands in a later row, after the driver was seen to let go.
_GOES_ON = {("G1 F500 X2␊", 0), ("?", 2), ("$J=G91X1F300␊", 0)}
_LIMIT = ("?", 7)
_PWM = {("\\x18", 1): 0, ("M3 S1000␊", 0): 255, ("M5␊", 1): 0}


def test_every_row_of_the_recorded_dialogue_is_reproduced() -> None:
    rows = read_transcript("Grbl 1.1h")
    board = Grbl(Plant(Wiring(Grbl.steps_per_turn)), is_blank=True)
    player, seen, began, wrong = Player(board), dict[str, int](), None, list[str]()
    for row in rows:
        key = row.text, seen.get(row.text, 0)
        seen[row.text] = key[1] + 1
        setting = _BOOT if row.is_open else _SETTINGS.get(key, Setting())
        played = _hit_the_switch(board, player, row) if key == _LIMIT else player.play(row, setting)
        if began is not None:
            played = dataclasses.replace(played, begin=began)
        began = played.begin if key in _GOES_ON else None
        if key in _PWM:
            assert board.pwm == _PWM[key]
        skip = ["travel"] if key in _GOES_ON else []
        wrong += [f"line {row.line}: {text}" for text in played.differences(row, Tolerance(), skip=skip)]
    assert not wrong, "\n".join(wrong)
    assert len(rows) == 54


def _hit_the_switch(board: Grbl, player: Player, row: Row) -> Played:
    """The limit switch closes in mid-move, half a millisecond before the request."""
    begin = board.planner.position(player.now_s)[0]
    board.receive(b"G1 F500 X50\n", player.now_s)
    player.now_s += 0.4006
    board.trip_limit(player.now_s)
    player.now_s += 0.0005
    return dataclasses.replace(player.play(row), begin=begin)


def test_grblhal_repeats_an_error_until_an_empty_line_comes() -> None:
    heard = _dialogue(GrblHal, b"hello\nM5\nG90\n\nM5\n")
    assert heard == b"error:2\r\nerror:2\r\nerror:2\r\nok\r\nok\r\n"


def test_crlf_is_one_line_end_for_grblhal_and_two_for_grbl() -> None:
    assert _dialogue(GrblHal, b"M5\r\n") == b"ok\r\n"
    assert _dialogue(Grbl, b"M5\r\n") == b"ok\r\nok\r\n"


def test_grblhal_takes_the_word_that_lights_a_ciclop_and_lights_nothing() -> None:
    board = _started(GrblHal)
    board.receive(b"M71 T1\n", board.now_s)
    board.advance(board.now_s + 0.1)
    assert board.sent() == b"ok\r\n"
    assert not board.plant.at(board.now_s).outputs_on


@pytest.mark.parametrize(("kind", "room"), [(Grbl, 15), (GrblHal, 35)])
def test_a_line_is_answered_when_queued_until_the_queue_is_full(kind: type[Grbl], room: int) -> None:
    board = _started(kind)
    # One at a time, as the small buffer asks for.
    for number in range(60):
        board.receive(b"G1X%d.5F60\n" % number, board.now_s)
        board.advance(board.now_s + 0.005)
    assert board.sent().count(b"ok") == room


def test_moves_the_same_way_run_through_and_a_turn_back_stops() -> None:
    through, back = _started(Grbl), _started(Grbl)
    through.receive(b"G1X2F480\nG1X4\nG4P0\n", through.now_s)
    back.receive(b"G1X2F480\nG1X0\nG4P0\n", back.now_s)
    for board, expected in ((through, 4.0), (back, 0.0)):
        board.advance(board.now_s + 5.0)
        assert board.plant.at(board.now_s).angle_deg == pytest.approx(expected * 250.0 * 360.0 / 3200.0)
    one_way = _ended_s(through) - _ended_s(back)
    # From rest to rest twice over 2 units against once over 4, at 10 units/s².
    assert one_way == pytest.approx(2.0 * (4.0 / 10.0) ** 0.5 - 4.0 * (2.0 / 10.0) ** 0.5, abs=0.02)


def test_a_feed_below_what_the_timer_can_do_turns_faster_than_asked() -> None:
    board = _started(Grbl)
    board.receive(b"G1X1F1\nG4P0\n", board.now_s)
    board.advance(board.now_s + 20.0)
    # 250 steps at 30.5 a second, not 60 s for a unit at one a minute.
    assert _ended_s(board) == pytest.approx(250.0 / 30.5, rel=0.02)


def test_in_laser_mode_a_beam_does_not_light_before_a_move() -> None:
    board = _started(Grbl)
    board.receive(b"$32=1\n", board.now_s)
    board.advance(board.now_s + 0.1)
    board.receive(b"M3 S1000\n", board.now_s)
    board.advance(board.now_s + 0.1)
    assert not board.plant.at(board.now_s).outputs_on


def test_a_jog_is_cancelled_by_its_own_byte_and_the_board_is_idle_again() -> None:
    board = _started(Grbl)
    board.receive(b"$J=G91X50F480\n", board.now_s)
    board.advance(board.now_s + 1.0)
    board.receive(b"\x85", board.now_s)
    board.advance(board.now_s + 2.0)
    board.receive(b"?", board.now_s)
    board.advance(board.now_s + 0.1)
    assert b"<Idle|" in board.sent()
    stood = board.plant.at(board.now_s).angle_deg
    assert board.planner.position(board.now_s)[0] == pytest.approx(stood * 3200.0 / 360.0)


def test_lasers_are_two_pins_that_know_nothing_of_each_other() -> None:
    board = _started(Grbl)
    board.receive(b"M3 S500\nM8\n", board.now_s)
    board.advance(board.now_s + 0.1)
    assert board.plant.at(board.now_s).outputs_on == {SPINDLE, COOLANT}
    assert board.pwm == 128


def _started(kind: type[Grbl]) -> Grbl:
    board = kind(Plant(Wiring(kind.steps_per_turn)))
    board.reset(0.0)
    board.advance(2.0)
    board.sent()
    return board


def _dialogue(kind: type[Grbl], request: bytes) -> bytes:
    board = _started(kind)
    board.receive(request, board.now_s)
    board.advance(board.now_s + 1.0)
    return board.sent()


def _ended_s(board: Grbl) -> float:
    """When the last `ok` came, from the request on."""
    return board.sent_with_times()[-1][0] - 2.0
