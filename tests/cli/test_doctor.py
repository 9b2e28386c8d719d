"""`turnscan doctor` as a person runs it: what it says, its exit code, its file."""

import json
from pathlib import Path

import pytest
from command_line import turnscan

from benchmarks.bench_text import simulated_bench


@pytest.fixture
def bench_file(tmp_path: Path) -> Path:
    return tmp_path / "bench.toml"


def plant(bench_file: Path, right: int = 2, **planted: bool) -> Path:
    bench_file.write_text(
        simulated_bench(
            {"width": 640, "height": 360, "rate": 16.0, **planted},
            name="small bench", turntable='direction = "ccw"\nsettle_s = 0.0\n', right=right,
            marker_mm=14.0, markers=8,
        )
    )  # fmt: skip
    return bench_file


def test_a_healthy_bench_ends_well_and_in_a_report(bench_file: Path, tmp_path: Path) -> None:
    out = tmp_path / "report.json"
    ended = turnscan(
        "doctor", "--bench", plant(bench_file), "--only", "board,machine,lasers", "--folder", tmp_path,
        "--json", out,
    )  # fmt: skip

    assert ended.code == 0, ended.said
    assert "All that was measured is in order." in ended.said
    report = json.loads(out.read_text())
    assert report["bench"] == "small bench"
    assert report["is_well"]
    assert {finding["check"] for finding in report["findings"]} >= {"machine.disk", "lasers.which"}


def test_a_fault_is_told_with_what_to_do_and_ends_with_1(bench_file: Path) -> None:
    ended = turnscan("doctor", "--bench", plant(bench_file, wrong_direction=True), "--only", "turntable")

    assert ended.code == 1
    assert "wrong direction" in ended.said
    assert 'direction = "cw"' in ended.said


def test_a_laser_on_a_channel_that_the_board_lacks_is_named(bench_file: Path) -> None:
    ended = turnscan("doctor", "--bench", plant(bench_file, right=7), "--only", "lasers")

    assert ended.code == 1
    assert "channel 7, which the board does not have" in ended.said


def test_a_check_that_does_not_exist_is_refused(bench_file: Path) -> None:
    ended = turnscan("doctor", "--bench", plant(bench_file), "--only", "soul")

    assert ended.code == 2
    assert "'soul'" in ended.sentence
    assert "turntable" in ended.sentence


def test_a_board_that_is_not_there_leaves_what_can_be_looked_at(bench_file: Path, tmp_path: Path) -> None:
    text = (
        plant(bench_file)
        .read_text()
        .replace('driver = "simulated"\ndirection', f'driver = "horus"\nport = "{tmp_path}/none"\ndirection')
    )
    bench_file.write_text(text)
    ended = turnscan("doctor", "--bench", bench_file, "--only", "picture,turntable")

    assert ended.code == 1
    assert f"{tmp_path}/none" in ended.said
    assert "the board is not connected" in ended.said


def test_a_bench_of_which_nothing_is_there_cannot_be_looked_at(bench_file: Path, tmp_path: Path) -> None:
    bench_file.write_text(
        f'[turntable]\ndriver = "horus"\nport = "{tmp_path}/none"\n'
        f'[camera]\ndriver = "folder"\nfolder = "{tmp_path}/no-pictures"\n'
    )
    ended = turnscan("doctor", "--bench", bench_file)

    assert ended.code == 2
    assert ended.sentence
    assert "Traceback" not in ended.said
