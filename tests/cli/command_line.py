"""Running commands as a person would, and recordings that something happened to."""

import io
import json
import os
import shutil
from collections.abc import Callable
from contextlib import redirect_stderr
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app.cli.main import run

ERROR = "Error:"


@dataclass(frozen=True)
class Ended:
    """How a command ended: its exit code, and what it said on standard error, spaces evened."""

    code: int
    said: str

    @property
    def sentence(self) -> str:
        """What went wrong, and what to do about it."""
        assert ERROR in self.said, self.said
        return self.said.split(ERROR, 1)[1].strip()


def turnscan(*arguments: object) -> Ended:
    """Run one command."""
    said = io.StringIO()
    with redirect_stderr(said):
        code = run([str(argument) for argument in arguments])
    return Ended(code, " ".join(said.getvalue().split()))


def copied(recording: Path, to: Path) -> Path:
    """A copy whose files are links: to change one, put another in its place."""
    shutil.copytree(recording, to, copy_function=os.link)
    return to


def rewritten(recording: Path, change: Callable[[dict[str, Any]], None]) -> None:
    """Change the manifest of a copy."""
    path = recording / "recording.json"
    document = json.loads(path.read_text())
    change(document)
    path.unlink()
    path.write_text(json.dumps(document))


def replaced(path: Path, data: bytes) -> None:
    """Other bytes in place of a linked file."""
    path.unlink()
    path.write_bytes(data)


def files_below(folder: Path) -> set[str]:
    """Names of everything in a folder, temporary files included."""
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


def frame_of(recording: Path, role: str) -> Path:
    """The first picture of a role."""
    frames = json.loads((recording / "recording.json").read_text())["frames"]
    return recording / str(next(frame["file"] for frame in frames if frame["role"] == role))
