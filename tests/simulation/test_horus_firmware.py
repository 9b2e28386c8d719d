"""What Horus boards do that no recorded row shows: timers, lost lines, the older and the cloned firmware."""

import pytest

from app.simulation.firmware.dialects.horus import Horus
from app.simulation.firmware.dialects.horus_0_1 import HorusFirst
from app.simulation.firmware.dialects.horus_clone import HorusClone
from app.simulation.firmware.kernel import Firmware
from app.simulation.firmware.plant import Plant, Wiring


class Board:
    """A board that one talks to in virtual time."""

    def __init__(self, firmware: type[Firmware]) -> None:
        self.firmware = firmware(Plant(Wiring(firmware.steps_per_turn)))
        self.now_s = 0.0
        self.firmware.reset(0.0)
        self.banner = self.listen(1.2)

    def listen(self, duration_s: float) -> str:
        self.now_s += duration_s
        self.firmware.advance(self.now_s)
        return self.firmware.sent(self.now_s).decode("latin-1")

    def ask(self, text: str, duration_s: float = 0.1) -> str:
        self.firmware.receive(text.encode("latin-1"), self.now_s)
        return self.listen(duration_s)

    @property
    def angle_deg(self) -> float:
        return self.firmware.plant.at(self.now_s).angle_deg

    @property
    def lit(self) -> frozenset[int]:
        return self.firmware.plant.at(self.now_s).outputs_on


@pytest.fixture
def board() -> Board:
    return Board(Horus)


def test_a_laser_goes_out_after_254_s_and_only_m70_ends_that(board: Board) -> None:
    board.ask("M71T1\n")
    board.listen(250.0)
    assert board.lit == {0}
    assert board.ask("M71T1\n") == "ok\r\n"
    board.listen(5.0)
    assert board.lit == frozenset()
    board.ask("M71T1\n")
    assert board.lit == frozenset()
    board.ask("M70T1\nM71T1\n")
    assert board.lit == {0}


def test_a_laser_goes_out_in_the_middle_of_a_long_move(board: Board) -> None:
    board.ask("M71T2\nG1F3.5X1800\n")
    board.listen(260.0)
    assert board.lit == frozenset()
    assert board.firmware.plant.at(board.now_s).is_moving


def test_turning_cannot_be_slower_than_the_timer_counts(board: Board) -> None:
    board.ask("G1F0.5X30\n", 5.0)
    assert board.angle_deg == pytest.approx(5.0 * 30.5 * 360.0 / 3200.0, rel=0.02)


def test_turning_cannot_be_faster_than_the_setting(board: Board) -> None:
    board.ask("G1F900X720\n", 4.0)
    assert board.angle_deg == pytest.approx(180.0 * 3.5, rel=0.01)


def test_lines_pipelined_beyond_the_buffer_are_lost_without_a_word(board: Board) -> None:
    board.ask("M17\nG1F90X90\n")
    board.ask("M71T1\n" * 21 + "M70T1\n" * 2)
    answers = board.listen(3.0)
    assert board.firmware.lost_bytes == 6 * 23 - 127
    assert answers.count("ok") == 22
    assert board.lit == {0}


def test_m50_switches_the_laser_it_names(board: Board) -> None:
    board.ask("M71T1\n")
    assert board.ask("M50T2\n") == "123\r\nok\r\n"
    assert board.lit == {0, 1}


def test_settings_survive_a_reset_and_the_position_does_not(board: Board) -> None:
    board.ask("$120=90\nG1F90X45\n", 2.0)
    board.firmware.reset(board.now_s)
    board.listen(1.2)
    assert "$120=90.000 " in board.ask("$$\n")
    assert "MPos:0.000" in board.ask("?")


def test_a_held_move_stands_on_a_whole_step_and_a_reset_keeps_it(board: Board) -> None:
    board.ask("G1F90X300\n", 1.0)
    board.ask("!", 0.2)
    assert "<Hold" in board.ask("?", 0.02)
    board.listen(1.0)
    before = board.ask("?")
    assert "<Queue" in before
    assert board.ask("\x18") == "ok\r\n\r\nHorus 0.2 ['$' for help]\r\n"
    after = board.ask("?")
    assert "<Idle" in after
    assert after.split(",")[1] == before.split(",")[1]
    assert float(after.split(",")[1][5:]) == pytest.approx(board.angle_deg, abs=1e-3)


def test_version_0_1_has_no_g50() -> None:
    board = Board(HorusFirst)
    assert "Horus 0.1 [" in board.banner
    assert board.ask("G50\n") == "error: Unsupported command\r\n"
    assert board.ask("$I\n") == "[0.1:]\r\nok\r\n"


def test_the_clone_says_nothing_where_it_is_at_a_loss() -> None:
    board = Board(HorusClone)
    assert board.banner == "\r\nHorus 0.2 ['$' for help]\r\n"
    for text in ("?", "\n", "$$\n", "$X\n", "hello\n", "m17\n", "M70\n"):
        assert board.ask(text) == ""
    for text in ("M50T1\n", "M17\n", "$120=50\n", "G1F90\n", "M70T1\r\n"):
        assert board.ask(text) == "ok\r\n"


def test_the_clone_turns_by_whole_degrees_to_one_of_512_places() -> None:
    board = Board(HorusClone)
    for asked, places in (("1.9", 1), ("2", 2), ("90", 128), ("-1", -1), ("360", 512)):
        assert board.ask(f"G1X{asked}\n", 8.0) == "ok\r\n"
        assert board.angle_deg == pytest.approx(places * 360.0 / 512.0)
    assert board.ask("G1F5X0\n") == "ok\r\n"
    assert board.angle_deg == pytest.approx(360.0)


def test_the_clone_counts_with_16_bits() -> None:
    board = Board(HorusClone)
    assert board.ask("G1X5760\n", 120.0) == "ok\r\n"
    assert board.angle_deg == pytest.approx(-5760.0)


def test_the_clone_keeps_lasers_and_place_over_a_reset_byte() -> None:
    board = Board(HorusClone)
    board.ask("M71T1\nM71T2\nG1X90\n", 5.0)
    assert "Horus" in board.ask("\x18")
    board.listen(300.0)
    assert board.lit == {0, 1}
    board.ask("G1X0\n", 5.0)
    assert board.angle_deg == pytest.approx(0.0)
