"""The emulated FabScanPi board says and does what the recorded one did."""

import pytest
from transcripts import Player, Setting, Tolerance, read_transcript

from app.simulation.firmware.dialects.fabscan import FabScan, usual_counts_per_step
from app.simulation.firmware.plant import Plant, Wiring

# Rows whose table tells in a note, or not at all, what surrounded them: by text, and which of that text.
_SETTINGS = {
    ("M19;␊", 1): Setting(before=((b"G02 T1600 F800;\n", 0.421),)),
    ("20 times M19; M20;", 0): Setting(before=((b"G02 T800 F800;\n", 0.304),)),
    ("G02 T32768 F1000;␊", 0): Setting(quiet_s=2.231),
    ("M05 R10 G6 B0;␊", 0): Setting(quiet_s=0.865),
}
_BOOT = Setting(quiet_s=1.3)
# The table stops only in the row that follows, which has the whole way.
_GOES_ON = {"G02 T32768 F1000;␊", "M05 R10 G6 B0;␊"}
_RINGS = {"M05 R0 G0 B255;␊": (0, 0, 255), "M04 R255 G0 B0;␊": (255, 0, 0), "M05 R10 G6 B0;␊": (10, 6, 0)}


def test_every_row_of_the_recorded_dialogue_is_reproduced() -> None:
    rows = read_transcript("FabScanPi")
    board = FabScan(Plant(Wiring(FabScan.steps_per_turn)))
    player, seen, began, wrong = Player(board), dict[str, int](), None, list[str]()
    for row in rows:
        number = seen.get(row.text, 0)
        seen[row.text] = number + 1
        played = player.play(row, _BOOT if row.is_open else _SETTINGS.get((row.text, number)))
        # A reset lets the driver go before the program touches it; a table cut short leaves things out.
        skip = ["driver"] if row.is_open else []
        skip += ["lost", "travel"] if row.is_cut else []
        if row.text in _GOES_ON:
            began, skip = played.begin, [*skip, "travel"]
        elif began is not None:
            assert row.travel is not None
            assert (began, played.end) == (row.travel.begin, row.travel.end), row.text
            began, skip = None, [*skip, "travel"]
        if row.is_open:
            assert played.driver[-2:] == (True, False)
        if row.text in _RINGS:
            assert board.ring == _RINGS[row.text]
        wrong += [f"line {row.line}: {text}" for text in played.differences(row, Tolerance(), skip=skip)]
    assert not wrong, "\n".join(wrong)
    assert len(rows) == 49


@pytest.mark.parametrize(
    ("version", "board", "baud", "counts", "name"),
    [
        ("v.20160914", 0, 115200, 1, b""),
        ("v.20170705", 0, 57600, 1, b""),
        ("v.20170302", 0, 115200, 2, b""),
        ("v.20181105", 1, 115200, 4, b"1\r\n"),
        ("12337", 4, 57600, 4, b"4\r\n"),
        ("v.20210318", 2, 14400, 4, b"2\r\n"),
        ("v.20240530", 5, 115200, 4, b"5\r\n"),
    ],
)
def test_versions_have_their_own_rate_and_scale_and_name(
    version: str, board: int, baud: int, counts: int, name: bytes
) -> None:
    plant = Plant(Wiring(FabScan.steps_per_turn))
    firmware = FabScan(plant, version, board)
    assert (firmware.baud, firmware.counts_per_step) == (baud, counts)
    firmware.reset(0.0)
    firmware.receive(b"M200;\n", 1.5)
    firmware.advance(2.0)
    prompt = b">" if version == "v.20160914" else b">\r\n"
    assert firmware.sent() == b"M200;\n" + version.encode() + b"\r\n" + prompt
    firmware.receive(b"M201;\n", 2.0)
    firmware.advance(3.0)
    assert firmware.sent() == b"M201;\n" + name + prompt
    firmware.receive(b"M17;\n", 3.0)
    firmware.receive(b"G01 T-%d F800;\n" % (10 * counts), 3.1)
    firmware.advance(4.0)
    assert plant.at(4.0).angle_deg == pytest.approx(-10 * 360.0 / 3200.0)


def test_a_speed_beyond_the_processor_is_capped() -> None:
    plant = Plant(Wiring(FabScan.steps_per_turn))
    firmware = FabScan(plant)
    firmware.reset(0.0)
    firmware.receive(b"M17;\nG01 T12300 F3000;\n", 1.5)
    firmware.advance(6.0)
    assert plant.at(6.0).is_moving
    firmware.advance(6.7)
    assert not plant.at(6.7).is_moving


def test_the_scale_changed_twice() -> None:
    dates = (20160101, 20170301, 20170701, 20181101, 20240530)
    assert [usual_counts_per_step(date) for date in dates] == [1, 2, 1, 4, 4]
