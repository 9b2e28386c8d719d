"""The emulated Marlin board says and does what the recorded one did."""

import pytest
from transcripts import Player, Setting, Tolerance, read_transcript

from app.simulation.firmware.dialects.marlin import Marlin
from app.simulation.firmware.marlin_motion import E, X
from app.simulation.firmware.plant import Plant, Wiring

# What surrounded a row and its table tells in a note or not at all: by text, and which of that text.
_SETTINGS = {
    ("(open)", 0): Setting(quiet_s=1.546),
    ("G1 X10 F1000␊", 0): Setting(quiet_s=0.58),
    ("M114␊", 2): Setting(before=((b"G1 X90 F1800\n", 0.4),)),
    ("M410␊", 0): Setting(before=((b"G1 X90 F1800\n", 0.4165),)),
}
# Redrawing the display holds up the main loop by up to 20 ms now and then.
_TOLERANCE = Tolerance(least_ms=21.0, part=0.01)
# The table's moves that go on into the next row, which has the whole way.
_GOES_ON = {("G1 X10 F1000␊", 0)}
_EXTRUDER_ROW = "G1 E10 F1000␊M400␊"
_FANS = {"M106 S255␊": {0: 255}, "M107␊": {0: 0}}
_FOUR_DRIVERS = {"M17␊": True, "M112␊": False}


def test_every_row_of_the_recorded_dialogue_is_reproduced() -> None:
    rows = read_transcript("Marlin")
    plant = Plant(Wiring(Marlin.steps_per_turn))
    board = Marlin(plant)
    player, seen, began, wrong = Player(board), dict[str, int](), None, list[str]()
    for row in rows:
        key = (row.text, seen.get(row.text, 0))
        seen[row.text] = key[1] + 1
        extruded = board.motion.count(E, player.now_s)
        played = player.play(row, _SETTINGS.get(key))
        skip = []
        if key in _GOES_ON:
            began, skip = played.begin, ["travel"]
        elif began is not None:
            assert row.travel is not None
            assert (began, played.end) == (row.travel.begin, row.travel.end)
            began, skip = None, ["travel"]
        if row.text == _EXTRUDER_ROW:
            assert row.travel is not None
            assert board.motion.count(E, player.now_s) - extruded == row.travel.end
            skip = ["travel"]
        if row.text in _FOUR_DRIVERS:
            # The recorded board has four motors, the plant one.
            assert set(row.driver) == {_FOUR_DRIVERS[row.text]}
            assert plant.at(player.now_s).is_holding == _FOUR_DRIVERS[row.text]
            skip = ["driver"]
        if row.text in _FANS:
            assert board.fans == _FANS[row.text]
        wrong += [f"line {row.line}: {text}" for text in played.differences(row, _TOLERANCE, skip=skip)]
    assert not wrong, "\n".join(wrong)
    assert len(rows) == 36


def talk(board: Marlin, text: str, wait_s: float = 1.0) -> str:
    board.receive(text.encode() + b"\n", board.now_s)
    board.advance(board.now_s + wait_s)
    return board.sent().decode()


def started(version: str = "1.1.1", table_axis: str = "X") -> Marlin:
    board = Marlin(Plant(Wiring(Marlin.steps_per_turn)), version, table_axis, fan_lasers={0: 0, 1: 1})
    board.reset(0.0)
    board.advance(7.0)
    assert f"Marlin {version}\n" in board.sent().decode()
    return board


def test_version_2_knows_no_m42_and_switches_lasers_as_fans() -> None:
    board = started("2.0.9.3")
    assert talk(board, "M42 P11 S255") == 'echo:Unknown command: "M42 P11 S255"\nok\n'
    assert talk(board, "M71 T1") == 'echo:Unknown command: "M71 T1"\nok\n'
    assert not board.plant.at(board.now_s).outputs_on
    assert talk(board, "M106 P1 S255") == "ok\n"
    assert board.plant.at(board.now_s).outputs_on == {1}
    assert talk(board, "M107 P1") == "ok\n"
    assert not board.plant.at(board.now_s).outputs_on


def test_version_2_ends_its_capabilities_with_cr_lf_and_takes_commands_at_once() -> None:
    board = Marlin(Plant(Wiring(Marlin.steps_per_turn)), "2.0.9.3")
    board.reset(0.0)
    board.advance(1.5)
    board.sent()
    told = talk(board, "M115", 0.1).splitlines(keepends=True)
    assert told[0].startswith("FIRMWARE_NAME:Marlin 2.0.9.3")
    assert told[0].endswith("\n")
    assert "\r" not in told[0]
    assert len(told) > 3
    assert all(line.startswith("Cap:") and line.endswith("\r\n") for line in told[1:-1])
    assert told[-1] == "ok\n"


def test_a_board_turns_no_slower_than_its_timer() -> None:
    board = started()
    talk(board, "G1 X1 F6", 0.0)
    board.advance(board.now_s + 2.0)
    assert board.plant.at(board.now_s).is_moving
    board.advance(board.now_s + 0.6)
    assert not board.plant.at(board.now_s).is_moving


def test_software_endstops_keep_the_table_on_the_bed_until_they_are_switched_off() -> None:
    board = started()
    talk(board, "M121")
    talk(board, "G1 X-10 F6000")
    assert board.motion.count(X, board.now_s) == 0
    talk(board, "G1 X250 F12000", 4.0)
    assert board.motion.count(X, board.now_s) == 200 * 80.2
    talk(board, "M211 S0")
    talk(board, "G1 X-10 F12000", 4.0)
    assert board.motion.count(X, board.now_s) == -802


def test_the_extruder_refuses_long_ways_and_believes_it_has_gone_them() -> None:
    board = started(table_axis="E")
    talk(board, "M302 P1")
    assert talk(board, "G1 E300 F1500") == "echo: too long extrusion prevented\nok\n"
    assert not board.plant.at(board.now_s).angle_deg
    assert "E:300.00" in talk(board, "M114")
    talk(board, "G1 E310 F1500", 2.0)
    assert board.plant.at(board.now_s).angle_deg == pytest.approx(360.0 * 960 / 3200)


def test_after_a_quick_stop_the_extruder_is_thought_to_be_where_it_should_have_gone() -> None:
    board = started(table_axis="E")
    talk(board, "M302 P1")
    talk(board, "G1 E20 F600", 0.5)
    talk(board, "M410", 0.1)
    assert "E:20.00" in talk(board, "M114")
    assert board.plant.at(board.now_s).angle_deg < 360.0 * 20 * 96 / 3200 / 2


def test_a_queue_that_is_full_makes_the_next_move_wait() -> None:
    board = started()
    talk(board, "G91")
    for _ in range(15):
        assert talk(board, "G1 X5 F600", 0.01) == "ok\n"
    assert talk(board, "G1 X5 F600", 0.02) == ""
    board.advance(board.now_s + 0.6)
    assert board.sent() == b"ok\n"


def test_a_numbered_line_with_the_right_sum_is_obeyed() -> None:
    assert talk(started(), "N1 M114*38").startswith("X:0.00")
