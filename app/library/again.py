"""A scan of the library, computed again: with another calibration, another detector, other options."""

import json
import math
import time
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Protocol

from app.calibration.platter_file import layout_of
from app.calibration.record import CalibrationRecord
from app.documents import Json
from app.errors import LibraryError
from app.files import write_whole
from app.library.derived import put_files
from app.library.item import CALIBRATION_FILE, CloudItem
from app.library.library import Library
from app.library.log import write_line
from app.library.work import settle, work_folder
from app.recording.reader import Recording
from app.scanning.drift import DriftReference
from app.scanning.reconstruct import ReconstructionOptions
from app.scanning.report import ReconstructionReport
from app.scanning.sources import reconstruct_recording, scan_detector
from app.surface.ply import PlyWriter
from app.surface.preview import PreviewPainter

DETECTOR = "zero-crossing"
# How fast it goes changes nothing in the cloud.
_OF_NO_EFFECT = frozenset({"workers", "ahead"})


class ShowPoints(Protocol):
    """Told how many profiles of how many are done, and how many points there are."""

    def __call__(self, done: int, total: int, points: int) -> None: ...


@dataclass(frozen=True, eq=False, slots=True)
class Again:
    """What came of it.

    Attributes:
        cloud: the new one; the others stay.
        report: what the reconstruction says of itself.
    """

    cloud: CloudItem
    report: ReconstructionReport


def reconstruct_again(
    library: Library,
    name: str,
    record: CalibrationRecord | None = None,
    detector: str = DETECTOR,
    options: ReconstructionOptions | None = None,
    progress: ShowPoints = lambda done, total, points: None,
) -> Again:
    """Add `clouds/<date>.ply` to a scan, its picture and a `.json` that says how it was made beside it.

    Args:
        library: where the scan is.
        name: of the scan.
        record: by default the calibration that lies in the scan's folder.
        detector: finds the stripes.
        options: see there.
        progress: told how it goes; what it raises ends the work, and nothing is left of it.

    Raises:
        ScanNotFound: there is no such scan.
        LibraryError: no calibration is named, and the scan has none.
        ScannerError: as `reconstruct_recording`; nothing is written then.
    """
    folder = library.scan(name).folder
    record = record or own_calibration(folder)
    options = options or ReconstructionOptions()
    began_s = time.monotonic()
    run = reconstruct_recording(
        Recording.open(folder),
        record.rig,
        scan_detector(detector, options.threshold),
        options,
        layout_of(record) or None,
        DriftReference.kept_in(record.extra),
    )
    painter = PreviewPainter()
    with work_folder(library.folder) as work:
        with PlyWriter(work / "cloud.ply", run.laser_names) as ply:
            for done, profile in enumerate(run, start=1):
                ply.append(profile.cloud)
                painter.add(profile.cloud)
                progress(done, max(run.total, done), ply.points)
        report = run.report()
        painter.write(work / "cloud.png")
        created = datetime.now(UTC)
        how = _how(created, detector, options, report, record, time.monotonic() - began_s)
        write_whole(work / "cloud.json", how)
        settle()
        file = put_files(library, name, work, created)
        words = f"Computed {file} with {detector}: {report.points} points."
        write_line(library.folder_of(name), " ".join([words, *report.warnings, *report.doubts]))
    cloud = next(cloud for cloud in library.scan(name).clouds if cloud.name == file)
    return Again(cloud, report)


def own_calibration(folder: Path) -> CalibrationRecord:
    """The calibration that lies in the folder of a scan.

    Raises:
        LibraryError: there is none.
        CalibrationFileError: it cannot be read.
    """
    path = folder / CALIBRATION_FILE
    if not path.is_file():
        raise LibraryError(
            f"The scan {folder.name!r} has no calibration of its own.", "Name one with --calibration."
        )
    return CalibrationRecord.load(path)


def _how(
    created: datetime,
    detector: str,
    options: ReconstructionOptions,
    report: ReconstructionReport,
    record: CalibrationRecord,
    took_s: float,
) -> bytes:
    """Everything that is needed to make the cloud again, the whole calibration too."""
    chosen: Json = {key: value for key, value in asdict(options).items() if key not in _OF_NO_EFFECT}
    limits = {key: str(v) for key, v in chosen.items() if isinstance(v, float) and not math.isfinite(v)}
    document: Json = {
        "format": "turnscan-cloud", "version": 1, "created": created.isoformat(),
        "detector": detector, "options": chosen | limits,
        "points": report.points, "profiles": report.profiles, "seconds": round(took_s, 3),
        "warnings": list(report.warnings), "doubts": list(report.doubts), "drift": report.drift.as_json(),
        "calibration": json.loads(record.to_bytes()),
    }  # fmt: skip
    return json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False).encode() + b"\n"
