"""A lock holds while its file is open, and no longer."""

import subprocess
import sys
from pathlib import Path

import pytest

from app.errors import OutputError
from app.locks import is_locked, lock
from app.recording.manifest import Header
from app.recording.writer import RecordingWriter

_HOLD = """
import sys
from pathlib import Path
from app.locks import lock
file = Path(sys.argv[1]).open("rb")
print(lock(file), flush=True)
sys.stdin.read()
"""


def test_a_lock_ends_with_its_file(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.touch()
    with path.open("rb") as first, path.open("rb") as second:
        assert lock(first)
        assert not lock(second)
        assert is_locked(path)
    assert not is_locked(path)


def test_a_file_that_is_not_there_is_not_locked(tmp_path: Path) -> None:
    assert not is_locked(tmp_path / "nothing")


def test_a_lock_ends_with_a_killed_program(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.touch()
    holder = subprocess.Popen(
        [sys.executable, "-c", _HOLD, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    with holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == b"True\n"
        assert is_locked(path)
        holder.kill()
    assert not is_locked(path)


def test_a_recording_has_one_writer(tmp_path: Path) -> None:
    writer = RecordingWriter.create(tmp_path / "r", Header.of((4, 3)))
    with pytest.raises(OutputError, match="another program"):
        RecordingWriter.resume(tmp_path / "r")
    writer.suspend()
    RecordingWriter.resume(tmp_path / "r").close()
