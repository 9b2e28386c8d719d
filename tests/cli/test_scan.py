"""`turnscan scan` as a person uses it: bench files, ends of every kind, and going on."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from command_line import Ended, turnscan

from app.recording.reader import Recording
from app.simulation.clock import Clock
from app.simulation.firmware.kernel import FIRMWARES
from app.simulation.firmware.plant import Plant, Wiring
from app.simulation.firmware.port import EmulatedPort
from benchmarks.bench_text import simulated_bench

_SIMULATED = simulated_bench(
    {"dialect": "horus", "object": "sphere", "width": 320, "height": 240, "rate": 20.0}
)
_EMULATED = """
[turntable]
driver = "horus"
port = "{port}"
settle_s = 0.0
[camera]
driver = "folder"
folder = "{folder}"
[[lasers]]
name = "left"
channel = 1
colour = "red"
"""


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    path = tmp_path / "bench.toml"
    path.write_text(_SIMULATED)
    return path


@pytest.fixture
def board(tmp_path: Path) -> Iterator[EmulatedPort]:
    firmware = FIRMWARES.make("horus", plant=Plant(Wiring(3200.0)))
    with EmulatedPort(firmware, tmp_path / "board", Clock(4.0)) as port:
        yield port


def test_a_scan_gives_a_recording_and_a_cloud(tmp_path: Path, bench: Path) -> None:
    outcome = turnscan(
        "scan", tmp_path / "scan", "--bench", bench, "--steps", "12", "-o", tmp_path / "ball.ply"
    )
    assert outcome.code == 0, outcome.said
    assert "36 pictures" in outcome.said
    assert (tmp_path / "ball.ply").stat().st_size > 1000
    assert (tmp_path / "scan" / "calibration.json").is_file()
    assert len(Recording.open(tmp_path / "scan").entries) == 36


def test_a_continuous_scan_from_the_command_line(tmp_path: Path) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text(_SIMULATED.replace("rate = 20.0", "rate = 1.0"))
    outcome = turnscan(
        "scan", tmp_path / "scan", "--bench", bench, "--mode", "continuous", "--laser", "left", "--no-dark",
        "--turn", "60", "--seconds-per-turn", "6",
    )  # fmt: skip
    assert outcome.code == 0, outcome.said
    recording = Recording.open(tmp_path / "scan")
    assert recording.seconds_per_turn == 6.0
    assert len(recording.entries) == pytest.approx(30, abs=2)


def test_a_scan_that_is_ended_keeps_its_pictures_and_goes_on(tmp_path: Path, bench: Path) -> None:
    folder = tmp_path / "scan"
    with _started("scan", str(folder), "--bench", str(bench), "--steps", "40") as running:
        _wait_for(lambda: _pictures(folder) > 3)
        running.send_signal(signal.SIGTERM)
        _, said = running.communicate(timeout=120.0)
    assert running.returncode == 2
    kept = Recording.open(folder)
    assert f"{len(kept.entries)} pictures are kept" in _plain(said)
    assert "--resume" in _plain(said)
    outcome = turnscan("scan", folder, "--resume")
    assert outcome.code == 0, outcome.said
    assert len(Recording.open(folder).entries) == 120


def test_a_killed_scan_leaves_no_laser_on_and_goes_on(
    tmp_path: Path, board: EmulatedPort, small_recording: Path
) -> None:
    folder, bench = tmp_path / "scan", tmp_path / "bench.toml"
    bench.write_text(_EMULATED.format(port=board.link, folder=small_recording))
    with _started("scan", str(folder), "--bench", str(bench), "--steps", "16") as running:
        _wait_for(lambda: _pictures(folder) > 5)
        _wait_for(lambda: bool(_plant(board).at(board.clock.now_s()).outputs_on))
        running.kill()
        running.communicate(timeout=120.0)
    _wait_for(lambda: not _plant(board).at(board.clock.now_s()).outputs_on)
    kept = len(Recording.open(folder).entries)
    assert kept > 5
    outcome = turnscan("scan", folder, "--resume", "--accept-position")
    assert outcome.code == 0, outcome.said
    assert len(Recording.open(folder).entries) == 32


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (("dialect =", "dialekt ="), "no option 'dialekt'"),
        (('driver = "simulated"\nsettle', 'driver = "horse"\nsettle'), "no controller board called 'horse'"),
        (('"simulated"\n[[', '"simulated"\nzoom = 3\n[['), "no option 'zoom'"),
        (("channel = 2", "channel = 1"), "two lasers with the channel 1"),
        (("[simulation]", "[simulation"), "is not TOML"),
        (("width = 320", "width = 3"), "3 x 240"),
        (('dialect = "horus"', 'dialect = "unheard"'), "unheard"),
    ],
)
def test_a_wrong_bench_file_is_one_sentence(
    tmp_path: Path, bench: Path, changed: tuple[str, str], said: str
) -> None:
    bench.write_text(_SIMULATED.replace(*changed))
    _check_refused(turnscan("scan", tmp_path / "scan", "--bench", bench), said, tmp_path / "scan")


def test_a_port_that_is_not_there_is_one_sentence(tmp_path: Path, small_recording: Path) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text(_EMULATED.format(port=tmp_path / "nothing", folder=small_recording))
    _check_refused(
        turnscan("scan", tmp_path / "scan", "--bench", bench), "there is no port", tmp_path / "scan"
    )


def test_a_port_of_something_else_is_one_sentence(tmp_path: Path, small_recording: Path) -> None:
    firmware = FIRMWARES.make("sardauscan", plant=Plant(Wiring(1018.0)))
    with EmulatedPort(firmware, tmp_path / "board", Clock(5.0)) as port:
        bench = tmp_path / "bench.toml"
        bench.write_text(_EMULATED.format(port=port.link, folder=small_recording))
        outcome = turnscan("scan", tmp_path / "scan", "--bench", bench)
    _check_refused(outcome, "answers as a Horus", tmp_path / "scan")


def test_an_unknown_laser_is_named_with_those_there_are(tmp_path: Path, bench: Path) -> None:
    outcome = turnscan("scan", tmp_path / "scan", "--bench", bench, "--laser", "middle")
    _check_refused(outcome, "no laser called 'middle'", tmp_path / "scan")
    assert "left, right" in outcome.said


def test_a_folder_with_something_in_it_is_not_written_to(tmp_path: Path, bench: Path) -> None:
    (tmp_path / "scan").mkdir()
    (tmp_path / "scan" / "letter.txt").write_text("dear aunt")
    outcome = turnscan("scan", tmp_path / "scan", "--bench", bench)
    assert outcome.code == 2
    assert [path.name for path in (tmp_path / "scan").iterdir()] == ["letter.txt"]


def test_what_is_no_scan_cannot_be_resumed(tmp_path: Path) -> None:
    outcome = turnscan("scan", tmp_path, "--resume")
    assert outcome.code == 2
    assert "scan.json" in outcome.said


def _check_refused(outcome: Ended, said: str, folder: Path) -> None:
    assert outcome.code == 2
    assert said in outcome.said
    assert "Traceback" not in outcome.said
    assert not folder.exists()


def _started(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "app", *arguments], stderr=subprocess.PIPE, text=True,
        env=os.environ | {"COLUMNS": "200"},
    )  # fmt: skip


def _pictures(folder: Path) -> int:
    return len(list((folder / "frames").glob("*.*"))) if (folder / "frames").is_dir() else 0


def _plant(board: EmulatedPort) -> Plant:
    return board.firmware.plant


def _plain(said: str) -> str:
    return re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", said)


def _wait_for(is_so: Callable[[], bool], timeout_s: float = 120.0) -> None:
    ends = time.monotonic() + timeout_s
    while not is_so():
        assert time.monotonic() < ends, "it never came to be"
        time.sleep(0.005)
