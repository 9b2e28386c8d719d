"""`result.json`: what became of one recording. It lies beside what was made."""

from enum import StrEnum
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, ValidationError

from app.files import write_whole

RESULT_FILE = "result.json"
_MOST_BYTES = 1 << 20


class Outcome(StrEnum):
    """How it ended for one recording."""

    DONE = "done"
    DOUBTFUL = "doubtful"
    FAILED = "failed"


class Result(BaseModel):
    """The file.

    Attributes:
        recording: its folder, whole path.
        fingerprint: of the recording and the settings, see `fingerprint`; empty where there was none to take.
        created: when it ended, UTC.
        seconds: that it took.
        calibration: the file that was used; empty where the recording's own pictures gave it.
        expected_error_mm: what the calibration foretells.
        points: of the raw cloud.
        triangles: of the mesh.
        size_mm: of the mesh along x, y and z.
        volume_cm3: of a closed mesh.
        files: what was made, names in the folder.
        notes, doubts: sentences for the person.
        problem, hint: why nothing came of it, and what to do.
    """

    model_config = ConfigDict(frozen=True)

    format: Literal["turnscan-batch-result"] = "turnscan-batch-result"
    version: Literal[1] = 1
    recording: str
    fingerprint: str = ""
    created: str = ""
    seconds: float = 0.0
    calibration: str = ""
    expected_error_mm: float | None = None
    points: int | None = None
    triangles: int | None = None
    size_mm: tuple[float, float, float] | None = None
    volume_cm3: float | None = None
    files: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    problem: str = ""
    hint: str = ""

    @property
    def outcome(self) -> Outcome:
        if self.problem:
            return Outcome.FAILED
        return Outcome.DOUBTFUL if self.doubts else Outcome.DONE

    @property
    def failure(self) -> str:
        """Problem and hint as sentences; empty where it did not fail."""
        if not self.problem:
            return ""
        return f"{self.problem.rstrip('.')}. {self.hint}".strip()


def read_result(folder: Path) -> Result | None:
    """The result that lies in a folder; None where none does, or none that can be read."""
    try:
        with (folder / RESULT_FILE).open("rb") as file:
            return Result.model_validate_json(file.read(_MOST_BYTES))
    except (OSError, ValidationError):
        return None


def write_result(folder: Path, result: Result) -> None:
    """Put it in place, whole.

    Raises:
        OutputError: it cannot be written.
    """
    write_whole(folder / RESULT_FILE, result.model_dump_json(indent=1).encode() + b"\n")
