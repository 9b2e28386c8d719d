"""What the library knows of a scan, read from its folder."""

import os
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import BaseModel, ConfigDict, ValidationError

from app.errors import LibraryError, PointCloudFileError
from app.library.about import parse_moment, read_about
from app.locks import is_locked
from app.recording.journal import JOURNAL_FILE, MANIFEST_FILE
from app.surface.ply_reader import ply_points

SCAN_FILE = "scan.json"
CALIBRATION_FILE = "calibration.json"
CLOUDS_FOLDER = "clouds"
RECORDED = frozenset({SCAN_FILE, MANIFEST_FILE, JOURNAL_FILE})
"""Any of these at the top of a folder makes it a recording."""

_MOST_BYTES = 256 << 20

ScanStatus = Literal["running", "paused", "finished", "recording", "cloud", "damaged"]
"""`recording` is one that no scan of this program made, `cloud` a folder with clouds alone."""


@dataclass(frozen=True, slots=True)
class CloudItem:
    """A cloud of a scan.

    Attributes:
        name: its file within the folder of the scan, such as `clouds/2026-11-21T10-00-00Z.ply`.
        points: how many its header promises.
        size_bytes: of the file.
        created: when it was written.
        picture: its picture within the folder; empty where there is none.
        detector: what found the stripes; empty where unknown.
        calibrated: when the calibration was made that it was computed with; None where unknown.
        made_by: `joined` of several scans, `cleaned` of another cloud; empty for what was scanned.
    """

    name: str
    points: int
    size_bytes: int
    created: datetime
    picture: str = ""
    detector: str = ""
    calibrated: datetime | None = None
    made_by: str = ""


@dataclass(frozen=True, slots=True)
class CalibrationNote:
    """Which calibration a scan was taken with."""

    created: datetime
    method: str
    expected_error_mm: float | None


@dataclass(frozen=True, slots=True)
class ScanItem:
    """A scan in the library.

    Attributes:
        name: its folder, which never changes while the scan is in the library.
        folder: where it lies.
        title: what people call it; its name where nobody gave it a title.
        note: free text.
        created: when it was begun.
        status: see `ScanStatus`.
        reason: why it is paused or damaged; empty otherwise.
        pictures: how many its recording has.
        size_bytes: of everything in the folder.
        clouds: oldest first.
        calibration: None where none lies beside the recording.
    """

    name: str
    folder: Path
    title: str
    note: str
    created: datetime
    status: ScanStatus
    reason: str
    pictures: int
    size_bytes: int
    clouds: tuple[CloudItem, ...]
    calibration: CalibrationNote | None

    @property
    def points(self) -> int:
        """Of the newest cloud; 0 without."""
        return self.clouds[-1].points if self.clouds else 0

    @property
    def thumbnail(self) -> Path | None:
        """Picture of the newest cloud that has one."""
        pictures = [cloud.picture for cloud in self.clouds if cloud.picture]
        return self.folder / pictures[-1] if pictures else None


class _Facts(BaseModel):
    """What is picked out of a file; the rest is passed over unchecked, for checking takes much longer."""

    model_config = ConfigDict(extra="ignore", frozen=True, strict=True)

    @classmethod
    def of(cls, path: Path) -> Self:
        """Raises ValueError where the file does not say it, OSError where it is not there."""
        if path.stat().st_size > _MOST_BYTES:
            raise ValueError(f"{path.name} is too large")
        try:
            return cls.model_validate_json(path.read_bytes())
        except ValidationError as error:
            raise ValueError(f"{path.name} is damaged") from error


class _ScanFacts(_Facts):
    status: Literal["running", "paused", "finished"]
    reason: str = ""


class _RecordingFacts(_Facts):
    frames: list[Any]


class _CalibrationFacts(_Facts):
    created: str
    method: str | None = None
    expected_error_mm: float | None = None


class _CloudFacts(_Facts):
    created: str | None = None
    detector: str = ""
    calibration: _CalibrationFacts | None = None
    made_by: str = ""


def read_item(folder: Path) -> ScanItem:
    """Look at everything in a folder; this takes the longer the more pictures there are.

    Raises:
        OSError: the folder went away meanwhile.
    """
    problem = ""
    title = note = ""
    size_bytes, earliest = _measured(folder)
    try:
        about = read_about(folder)
        title, note = about.title, about.note
        if about.created is not None:
            earliest = parse_moment(about.created)
    except LibraryError as error:
        problem = error.message
    status, reason, pictures = _recorded(folder)
    if problem and status not in ("running", "damaged"):
        status, reason = "damaged", problem
    return ScanItem(
        folder.name, folder, title or folder.name, note, earliest, status, reason, pictures, size_bytes,
        _clouds(folder), _calibration(folder),
    )  # fmt: skip


def unreadable(folder: Path, problem: str) -> ScanItem:
    """What there is to say of a folder that cannot be looked into."""
    created = datetime.fromtimestamp(folder.lstat().st_mtime, UTC).replace(microsecond=0)
    return ScanItem(folder.name, folder, folder.name, "", created, "damaged", problem, 0, 0, (), None)


def holds_scan(folder: Path) -> bool:
    """Whether a folder is a scan: a recording lies in it, or a cloud."""
    names = {path.name for path in folder.iterdir()}
    if names & RECORDED or any(map(is_cloud, names)):
        return True
    clouds = folder / CLOUDS_FOLDER
    return clouds.is_dir() and any(is_cloud(path.name) for path in clouds.iterdir())


def is_busy(folder: Path) -> bool:
    """Whether a program is writing the recording there now."""
    return is_locked(folder / JOURNAL_FILE)


def _recorded(folder: Path) -> tuple[ScanStatus, str, int]:
    """Status, reason and number of pictures."""
    status: ScanStatus = "cloud"
    reason = ""
    pictures = 0
    try:
        with suppress(FileNotFoundError):
            pictures = len(_RecordingFacts.of(folder / MANIFEST_FILE).frames)
            status = "recording"
        with suppress(FileNotFoundError):
            # One that is still there is newer than the manifest; its first line is no picture.
            pictures = max(0, (folder / JOURNAL_FILE).read_bytes().count(b"\n") - 1)
            status = "recording"
        with suppress(FileNotFoundError):
            facts = _ScanFacts.of(folder / SCAN_FILE)
            status, reason = facts.status, facts.reason
    except ValueError as error:
        return "damaged", str(error), pictures
    if is_busy(folder):
        return "running", "", pictures
    if status == "running":
        return "paused", "its program ended before it did", pictures
    return status, reason, pictures


def _measured(folder: Path) -> tuple[int, datetime]:
    """Bytes of all files, and the time of the oldest."""
    total, oldest_s = 0, folder.stat().st_mtime
    waiting = [str(folder)]
    while waiting:
        with suppress(FileNotFoundError), os.scandir(waiting.pop()) as entries:
            for entry in entries:
                facts = entry.stat(follow_symlinks=False)
                if entry.is_dir(follow_symlinks=False):
                    waiting.append(entry.path)
                    continue
                total += facts.st_size
                oldest_s = min(oldest_s, facts.st_mtime)
    return total, datetime.fromtimestamp(oldest_s, UTC).replace(microsecond=0)


def _clouds(folder: Path) -> tuple[CloudItem, ...]:
    found = []
    for place in (folder, folder / CLOUDS_FOLDER):
        with suppress(OSError):
            files = [path for path in place.iterdir() if is_cloud(path.name)]
            found += [_cloud(folder, path) for path in files if path.is_file() and not path.is_symlink()]
    return tuple(sorted(found, key=lambda cloud: (cloud.created, cloud.name)))


def is_cloud(name: str) -> bool:
    """Whether a file is a cloud, by its name."""
    return name.lower().endswith(".ply") and not name.startswith(".")


def _cloud(folder: Path, path: Path) -> CloudItem:
    """Of a file that is no PLY, too: 0 points."""
    facts = path.stat()
    created = datetime.fromtimestamp(facts.st_mtime, UTC)
    points, detector, calibrated, made_by = 0, "", None, ""
    with suppress(PointCloudFileError):
        points = ply_points(path)
    with suppress(OSError, ValueError):
        how = _CloudFacts.of(path.with_suffix(".json"))
        detector, made_by = how.detector, how.made_by
        created = created if how.created is None else parse_moment(how.created)
        calibrated = None if how.calibration is None else parse_moment(how.calibration.created)
    picture = path.with_suffix(".png")
    return CloudItem(
        path.relative_to(folder).as_posix(), points, facts.st_size, created,
        picture.relative_to(folder).as_posix() if picture.is_file() else "", detector, calibrated, made_by,
    )  # fmt: skip


def _calibration(folder: Path) -> CalibrationNote | None:
    with suppress(OSError, ValueError):
        facts = _CalibrationFacts.of(folder / CALIBRATION_FILE)
        return CalibrationNote(parse_moment(facts.created), facts.method or "", facts.expected_error_mm)
    return None
