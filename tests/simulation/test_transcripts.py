"""The reader of recorded dialogues, and the player, on a board that does nothing but echo."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from transcripts import BOARDS, Player, Row, Setting, Tolerance, read_transcript

from app.simulation.firmware.kernel import Firmware
from app.simulation.firmware.motion import ramped_move
from app.simulation.firmware.plant import Plant, Wiring

_TABLE = r"""
### Transcript: toy 1

| request | reply | latency, ms | pins / note |
| --- | --- | --- | --- |
| `(open)` | `hello⏎` | 1001 … 1002 after open | reset; driver on; driver off — first start |
| `L␊` | `L␊` | 0.1 | laser1 on at 0 — a laser |
| `G␊` | `G␊` | 0.2 | x 0→-40, 40 pulses in 0.40 s |
| `\x18⏎` | `\x18␍␊` | -0.2 … 0.1 | control bytes |
| `(5 times A)` | `A…(5)␊` | -0.4 … 0.1 | byte lost; byte lost; … 3 more — lost |
| `2 times M1; M2;` | `M1; … M2;␊` | -1.6 … 0.1 |  |
| `?` | `<a\|b>` | 0.1 | driver off; … 5 more |
| `␊` | — | | |

### Transcript: another
"""


class Echo(Firmware):
    """Echoes; `L` lights laser 1, `G` turns 40 steps back."""

    def on_reset(self) -> None:
        self.plant.hold(True, self.now_s)

    def program(self) -> Iterator[float]:
        self.plant.hold(False, self.now_s)
        self.say("hello\r\n")
        while True:
            byte = yield from self.read_byte()
            if byte == ord("L"):
                self.plant.switch(1, True, self.now_s)
            if byte == ord("G"):
                self.plant.move(ramped_move(self.now_s, 0.0, -40.0, 100.0, 1e6))
            self.say(bytes([byte]))


@pytest.fixture
def rows(tmp_path: Path) -> list[Row]:
    path = tmp_path / "boards.md"
    path.write_text(_TABLE, "utf-8")
    return read_transcript("toy", path)


def test_requests_are_the_bytes_that_were_sent(rows: list[Row]) -> None:
    assert [row.request for row in rows] == [
        b"", b"L\n", b"G\n", b"\x18\r\n", b"AAAAA\n", b"M1;\nM2;\nM1;\nM2;\n", b"?", b"\n",
    ]  # fmt: skip
    assert [row.is_open for row in rows] == [True] + 7 * [False]


def test_replies_match_with_what_the_table_leaves_out(rows: list[Row]) -> None:
    replies = [row.reply for row in rows]
    assert replies[4] is not None
    assert replies[4].fullmatch(b"AAAAA\n")
    assert not replies[4].fullmatch(b"AAAA\n")
    assert replies[5] is not None
    assert replies[5].fullmatch(b"M1;anything\r\nat all M2;\n")
    assert replies[6] is not None
    assert replies[6].fullmatch(b"<a|b>")
    assert replies[7] is None


def test_latencies_and_events_are_read(rows: list[Row]) -> None:
    assert [(row.first_ms, row.last_ms) for row in rows[:4]] == [
        (1001, 1002), (0.1, 0.1), (0.2, 0.2), (-0.2, 0.1),
    ]  # fmt: skip
    assert rows[0].driver == (True, False)
    assert rows[0].note == "first start"
    assert rows[1].lasers == ((1, True, 0),)
    travel = rows[2].travel
    assert travel is not None
    assert (travel.begin, travel.end, travel.pulses, travel.duration_s) == (0, -40, 40, 0.40)
    assert rows[3].note == "control bytes"
    assert rows[4].lost_bytes == 5
    assert rows[6].is_cut
    assert (rows[7].first_ms, rows[7].note) == (None, "")


def test_a_missing_file_skips_and_a_missing_table_fails(tmp_path: Path) -> None:
    with pytest.raises(pytest.skip.Exception):
        read_transcript("toy", tmp_path / "none.md")
    (tmp_path / "empty.md").write_text("nothing", "utf-8")
    with pytest.raises(AssertionError):
        read_transcript("toy", tmp_path / "empty.md")


def test_a_board_that_does_what_was_recorded_shows_no_difference(rows: list[Row]) -> None:
    player = Player(Echo(Plant(Wiring(3200.0))))
    for row in rows[:4]:
        assert player.play(row).differences(row) == []


def test_every_kind_of_difference_is_told(rows: list[Row]) -> None:
    player = Player(Echo(Plant(Wiring(3200.0))))
    opened = player.play(rows[0])
    assert re.match("said", opened.differences(rows[1])[0])
    told = " ".join(opened.differences(rows[1], Tolerance(0.5, 0.0)))
    for word in ("said", "first byte", "last byte", "lasers", "driver"):
        assert word in told
    assert "went 0→0 instead of 0→-40" in " ".join(opened.differences(rows[2]))
    assert "lost 0 bytes instead of 5" in " ".join(opened.differences(rows[4]))
    assert opened.differences(rows[2], skip=("reply", "latency", "lasers", "driver", "travel")) == []


def test_what_was_sent_before_the_row_belongs_to_its_reply_but_not_to_its_latency(rows: list[Row]) -> None:
    player = Player(Echo(Plant(Wiring(3200.0))))
    player.play(rows[0])
    played = player.play(rows[1], Setting(before=((b"x\n", 0.5),)))
    assert played.reply == b"x\nL\n"
    assert 0.0 < played.first_ms < 0.2


def test_all_the_recorded_dialogues_can_be_read() -> None:
    counts = {
        title: len(read_transcript(title))
        for title in ("horus-fw 0.2", "Grbl 1.1h", "FabScanPi ciclop", "Marlin 1.1.1")
    }
    assert min(counts.values()) > 30
    lines = BOARDS.read_text("utf-8").split("## 5 Transcripts")[1].splitlines()
    assert sum(line.startswith("| `") for line in lines) == sum(counts.values())
