"""One recording becomes a thing: calibrated, reconstructed, finished, with a picture. Runs in any process."""

import logging
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from app.batch.fingerprint import fingerprint
from app.batch.order import BatchOrder
from app.batch.result import Result, write_result
from app.calibration.calibrate import calibrate
from app.calibration.plan import CalibrationPlan
from app.calibration.platter_file import layout_of
from app.calibration.record import CalibrationRecord
from app.errors import ScannerError
from app.files import make_folder
from app.jobs.table_height import with_table
from app.library.thumbnail import paint_thumbnail
from app.recording.reader import Recording
from app.scanning.drift import DriftReference
from app.scanning.reconstruct import ReconstructionOptions
from app.scanning.sources import reconstruct_recording, scan_detector
from app.surface.exports.write import MESH_SUFFIXES, write_mesh
from app.surface.finish import finish
from app.surface.ply import PlyWriter
from app.surface.preview import PreviewPainter
from app.surface.thinning import read_thinned
from app.vision.stripe import STRIPE_DETECTORS

CLOUD_FILE, CALIBRATION_FILE, THUMBNAIL_FILE, MESH_NAME = (
    "cloud.ply", "calibration.json", "thumbnail.png", "thing",
)  # fmt: skip
# Of the whole, where each part begins: calibration, reconstruction, surface.
_CALIBRATED, _RECONSTRUCTED = 0.25, 0.6
_BROKEN_OFF = "The work on it was broken off before its end."
_log = logging.getLogger(__name__)

Tell = Callable[[str, float], None]
"""Told what is being done and which share of all is done."""


def make_thing(recording: str, folder: str, order: str, tell: Tell = lambda words, share: None) -> str:
    """Make of a recording what was ordered; what became of it is said in `result.json`.

    Args:
        recording: its folder.
        folder: for everything that is made.
        order: a `BatchOrder` as JSON.
        tell: told how far it is.

    Returns:
        The `Result` as JSON, also of what failed.
    """
    began_s = time.monotonic()
    work = _Work(Path(recording), Path(folder), BatchOrder.model_validate_json(order), tell)
    try:
        work.run()
    except ScannerError as error:
        work.failed(error.message, error.hint)
    except MemoryError:
        work.failed("There is too little memory for it.", "Use fewer --workers, or a coarser --detail.")
    except Exception as error:  # noqa: BLE001 (edge of a process: the other recordings go on)
        _log.exception("%s could not be made a thing", recording)
        work.failed(f"Something unforeseen went wrong: {type(error).__name__}: {error}", "Please report it.")
    facts = {"created": f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}", "seconds": time.monotonic() - began_s}
    result = work.result.model_copy(update=facts)
    try:
        write_result(work.folder, result)
    except ScannerError as error:
        result = result.model_copy(update={"problem": error.message, "hint": error.hint})
    return result.model_dump_json()


@dataclass(slots=True)
class _Work:
    """What is done for one recording, and what is known of it so far."""

    source: Path
    folder: Path
    order: BatchOrder
    tell: Tell
    result: Result = field(init=False)
    has_begun: bool = field(init=False, default=False)

    def __post_init__(self) -> None:
        self.result = Result(recording=str(self.source))

    def run(self) -> None:
        """Everything, in order.

        Raises:
            ScannerError: it cannot be done.
        """
        self.tell("opening", 0.0)
        recording = Recording.open(self.source)
        self._know(fingerprint=fingerprint(self.source, self.order))
        file = self.order.calibration_for(recording)
        record = None if file is None else CalibrationRecord.load(file)
        self._begin()
        if record is None:
            record = self._calibrated(recording)
        self._know(
            calibration="" if file is None else str(file),
            expected_error_mm=_or_none(record.expected_error_mm),
        )
        begin = _CALIBRATED if file is None else 0.0
        self._reconstruct(recording, record, begin)
        self._finish()
        self.tell("done", 1.0)

    def failed(self, problem: str, hint: str) -> None:
        # What an earlier run made stays while nothing can be made in its place.
        if self.has_begun:
            self._clear()
        self._know(problem=problem, hint=hint, files=())
        with suppress(ScannerError):
            make_folder(self.folder)

    def _know(self, **facts: object) -> None:
        self.result = self.result.model_copy(update=facts)

    def _add(self, notes: tuple[str, ...], doubts: tuple[str, ...]) -> None:
        self._know(notes=self.result.notes + notes, doubts=self.result.doubts + doubts)

    def _made(self, name: str) -> Path:
        self._know(files=(*self.result.files, name))
        return self.folder / name

    def _begin(self) -> None:
        """What an earlier run made goes; from here on the folder says that it is not finished."""
        make_folder(self.folder)
        self.has_begun = True
        self._clear()
        write_result(self.folder, self.result.model_copy(update={"problem": _BROKEN_OFF}))

    def _clear(self) -> None:
        """Nothing that was made stays, whichever run made it."""
        meshes = (f"{MESH_NAME}{suffix}" for suffix in MESH_SUFFIXES)
        made = [self.folder / name for name in (CLOUD_FILE, CALIBRATION_FILE, THUMBNAIL_FILE, *meshes)]
        left_by_a_killed_process = self.folder.glob(".*.part")
        for path in (*made, *left_by_a_killed_process):
            with suppress(OSError):
                path.unlink()

    def _calibrated(self, recording: Recording) -> CalibrationRecord:
        def show(stage: str, done: int, total: int | None) -> None:
            share = done / total if total else 0.9
            self.tell(f"calibrating: {stage.lower()}", _CALIBRATED * min(share, 1.0))

        outcome = calibrate(
            [recording],
            STRIPE_DETECTORS.make(self.order.detector),
            CalibrationPlan(skips_bad_frames=self.order.skips_bad_frames),
            show,
        )
        record = with_table(outcome.record, [recording], show)
        record.save(self._made(CALIBRATION_FILE))
        self._add(outcome.notes, outcome.doubts)
        return record

    def _reconstruct(self, recording: Recording, record: CalibrationRecord, begin: float) -> None:
        run = reconstruct_recording(
            recording,
            record.rig,
            scan_detector(self.order.detector),
            ReconstructionOptions(skips_bad_frames=self.order.skips_bad_frames),
            layout_of(record) or None,
            DriftReference.kept_in(record.extra),
        )
        with PlyWriter(self._made(CLOUD_FILE), run.laser_names) as ply:
            for number, profile in enumerate(run, start=1):
                ply.append(profile.cloud)
                share = number / max(run.total, number)
                self.tell("reconstructing", begin + (_RECONSTRUCTED - begin) * share)
        report = run.report()
        self._know(points=report.points)
        self._add(report.warnings, report.doubts)

    def _finish(self) -> None:
        order = self.order.finish
        read = read_thinned(self.folder / CLOUD_FILE, order.most_points)
        done = finish(
            [read.cloud],
            order,
            lambda words, share: self.tell(words, _RECONSTRUCTED + (1.0 - _RECONSTRUCTED) * share),
        )
        painter = PreviewPainter()
        painter.add(done.cloud)
        paint_thumbnail(self._made(THUMBNAIL_FILE), painter)
        assert done.mesh is not None
        for form in order.forms:
            write_mesh(self._made(f"{MESH_NAME}{form}"), done.mesh)
        low, high = done.mesh.bounds()
        self._know(triangles=len(done.mesh), size_mm=tuple((high - low).tolist()))
        self._add(read.notes + done.report.notes, done.report.doubts)
        printing = done.report.printing
        if printing is not None:
            bad = tuple(f"{one.sentence} {one.advice}" for one in printing.findings if one.advice)
            self._know(volume_cm3=printing.volume_cm3)
            self._add(bad, ()) if printing.is_printable else self._add((), bad)


def _or_none(number: float) -> float | None:
    return float(number) if np.isfinite(number) else None
