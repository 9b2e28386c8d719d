"""A disk that fills up and a person who loses patience: a sentence, exit code 2, nothing half written."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import files_below

from app.calibration.record import CalibrationRecord

_FULL = """
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, ({bytes}, {bytes}))
from app.cli.main import run
sys.exit(run(sys.argv[1:]))
"""
# The signal comes from outside the program's own code, as it does from the keyboard, but at a known moment.
_INTERRUPTED = """
import os, signal, sys
import {module}
signal.signal(signal.SIGINT, signal.default_int_handler)
calls, true = 0, {module}.{name}
def watched(*arguments, **options):
    global calls
    calls += 1
    if calls == {call}:
        os.kill(os.getpid(), signal.SIGINT)
    return true(*arguments, **options)
{module}.{name} = watched
from app.cli.main import run
sys.exit(run(sys.argv[1:]))
"""


def ended(program: str, *arguments: object) -> tuple[int, str]:
    """Exit code, and what was said on standard error, spaces evened."""
    process = subprocess.run(
        [sys.executable, "-c", program, *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        env={**os.environ, "COLUMNS": "200"},
    )
    return process.returncode, " ".join(process.stderr.split())


def commands(recording: Path, out: Path) -> dict[str, list[object]]:
    return {
        "reconstruct": ["reconstruct", recording, "-c", recording / "truth.json", "-o", out / "c.ply"],
        "calibrate": ["calibrate", recording, "-o", out / "rig.json"],
        "simulate": [
            "simulate", out / "s", "--width", 320, "--height", 240, "--steps", 4, "--parts", "scan",
        ],
        "import": [
            "import", recording / "frames", out / "r", "--laser", "left:red", "--pattern", "left",
            "--step", 5, "--direction", "ccw",
        ],
        "board": ["board", "charuco:7x5:25:18:DICT_4X4_50", "-o", out / "board.svg"],
    }  # fmt: skip


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """An empty folder for results."""
    folder = tmp_path / "out"
    folder.mkdir()
    return folder


@pytest.mark.parametrize("command", ["reconstruct", "simulate", "import", "board"])
def test_a_full_disk_is_told_and_nothing_is_left(command: str, small_recording: Path, out: Path) -> None:
    code, said = ended(_FULL.format(bytes=3000), *commands(small_recording, out)[command])
    assert code == 2, said
    assert "Error:" in said
    assert str(out) in said
    assert "file too large" in said
    assert "Free some space" in said
    assert "Traceback" not in said
    assert files_below(out) == set()


def test_a_disk_that_fills_up_at_the_report_leaves_the_calibration_whole(
    small_recording: Path, out: Path
) -> None:
    code, said = ended(_FULL.format(bytes=60_000), *commands(small_recording, out)["calibrate"])
    assert code == 2, said
    assert "rig.html: file too large" in said
    assert files_below(out) == {"rig.json"}
    assert CalibrationRecord.load(out / "rig.json").axis is not None


@pytest.mark.parametrize(
    ("command", "module", "name", "call"),
    [
        ("reconstruct", "app.recording.reader", "Recording.load", 12),
        ("calibrate", "app.calibration.solver", "residuals", 6),
        ("simulate", "app.recording.writer", "RecordingWriter.append_encoded", 5),
    ],
)
def test_a_person_who_stops_it_is_told_and_nothing_is_left(
    command: str, module: str, name: str, call: int, small_recording: Path, out: Path
) -> None:
    program = _INTERRUPTED.format(module=module, name=name, call=call)
    code, said = ended(program, *commands(small_recording, out)[command])
    assert code == 2, said
    assert "Stopped before the end: no result was written. Run the command again." in said
    assert "Traceback" not in said
    assert files_below(out) == set()
