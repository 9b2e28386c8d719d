"""The job that calibrates on the bench: takes what is missing, solves, proves, keeps."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from app.calibration.capture import PROOF_FOLDER, capture
from app.calibration.capture_session import CaptureSession
from app.calibration.outcome import CalibrationOutcome
from app.calibration.proof import Proof
from app.calibration.record import CalibrationRecord
from app.calibration.report import write_report
from app.calibration.store import CalibrationStore
from app.calibration.struck import Struck
from app.devices.bench import Bench
from app.errors import CalibrationFileError, OptionError, OutputError, PositionUnknown, ScannerError
from app.files import reason
from app.jobs.calibrate_boards import ShowBoards, boards_of
from app.jobs.calibrate_order import ORDER_FILE, CalibrationOrder
from app.jobs.calibrate_run import RECORDING_FOLDER, CalibrationRun
from app.jobs.calibrate_state import Kind, Step
from app.jobs.calibrate_views import views_on_disk
from app.jobs.runner import JobContext, Work
from app.recording.reader import Recording
from app.recording.shot import Role
from app.vision.stripe import STRIPE_DETECTORS

PICTURES_FOLDER = "pictures"
_REDONE = "to be taken again"
_ROLES = {
    Step.CAMERA: (Role.INTRINSICS,),
    Step.LASERS: (Role.LASER_PLANE,),
    Step.BOARD: (Role.AXIS,),
    Step.TABLE: (Role.BACKGROUND,),
}


def calibrate_work(
    bench: Bench,
    run: CalibrationRun,
    store: CalibrationStore,
    on_calibrated: Callable[[CalibrationRecord], None],
    on_boards: ShowBoards,
) -> Work:
    """Take what is not there yet, calibrate, and keep what comes of it.

    Args:
        bench: leased while pictures are taken.
        run: what people see and wish.
        store: where the calibration is kept.
        on_calibrated: told a calibration that is in use from now on.
        on_boards: then told where the board was.
    """

    def work(job: JobContext) -> Mapping[str, Any]:
        order = run.order
        _connect(bench)
        run.begin(job)
        try:
            captured = capture(
                bench, run.folder, order.board, run.ask, run.watch, order.capture_plan(run.limits),
                resumes=CaptureSession.is_begun(run.folder), struck=run.struck,
            )  # fmt: skip
            # A third of a second, which the server's start can do without.
            from app.jobs.calibrate_solve import solve_captured

            detector, plan = STRIPE_DETECTORS.make(order.detector), order.calibration_plan()
            outcome, proof = solve_captured(captured, detector, plan, run.solving)
            return _kept(job, run, store, outcome, proof, on_calibrated, on_boards)
        finally:
            run.rest()
            if bench.world is not None:
                # Whoever presses "scan" next finds the object on the table again.
                bench.world.put("object")

    return work


def redo(folder: Path, step: Step) -> None:
    """Let one step of a session be done again; what was taken stays on disk, and is left out.

    Raises:
        OptionError: the step takes no pictures.
        RecordingError, OutputError: the folder cannot be read or written.
    """
    if step in (Step.SOLVING, Step.PROVING):
        return
    recording = folder / RECORDING_FOLDER
    if step in (Step.BOARD, Step.PROOF):
        _put_aside(recording / PROOF_FOLDER)
    if step is Step.PROOF or not CaptureSession.is_begun(recording):
        return
    if step not in _ROLES:
        raise OptionError(f"The step {step.value!r} cannot be done again.", f"Name: {', '.join(_ROLES)}.")
    struck = Struck.load(recording)
    for number, entry in enumerate(Recording.open(recording).entries):
        if entry.role in _ROLES[step] and number not in struck.reasons:
            struck.strike(number, _REDONE)


@dataclass(frozen=True, slots=True)
class SessionFacts:
    """Pictures of a calibration, to go on with.

    Attributes:
        name: of the folder.
        kind: of the calibration.
        pictures: how many were taken.
        calibration: what came of them; empty where nothing yet.
        created: when it was begun, UTC.
        problem: why it cannot be gone on with; empty where it can.
    """

    name: str
    kind: Kind | None
    pictures: int
    calibration: str
    created: datetime
    problem: str


def sessions(store: CalibrationStore) -> list[SessionFacts]:
    """All that are kept, newest first."""
    return [_facts(path.parent) for path in sorted(_home(store).glob(f"*/{ORDER_FILE}"), reverse=True)]


def session_folder(store: CalibrationStore, name: str) -> Path | None:
    """Where the pictures of that name are; None where there are none. The name may come from anywhere."""
    return next(
        (path.parent for path in _home(store).glob(f"*/{ORDER_FILE}") if path.parent.name == name), None
    )


def new_session_folder(store: CalibrationStore) -> Path:
    """A folder that is not there yet."""
    stem = f"{datetime.now(UTC):%Y-%m-%dT%H-%M-%SZ}"
    folder, number = _home(store) / stem, 1
    while folder.exists():
        number += 1
        folder = _home(store) / f"{stem}.{number:03d}"
    return folder


def camera_in(store: CalibrationStore, size: tuple[int, int]) -> CalibrationRecord | None:
    """The newest calibration for pictures of that size, whose camera may be taken."""
    for kept in reversed(store.kept()):
        if kept.record is not None and kept.record.camera.size == size:
            return kept.record
    return None


def _home(store: CalibrationStore) -> Path:
    return store.folder / PICTURES_FOLDER


def _facts(folder: Path) -> SessionFacts:
    recording = folder / RECORDING_FOLDER
    created = datetime.fromtimestamp((folder / ORDER_FILE).stat().st_mtime, UTC)
    try:
        order = CalibrationOrder.load(folder)
        pictures = len(Recording.open(recording).entries) if CaptureSession.is_begun(recording) else 0
    except ScannerError as error:
        return SessionFacts(folder.name, None, 0, "", created, error.message)
    return SessionFacts(folder.name, order.kind, pictures, order.calibration, created, "")


def _connect(bench: Bench) -> None:
    try:
        bench.connect()
    except PositionUnknown:
        # A calibration counts its angles from wherever the table stands.
        bench.zero(0.0)


def _kept(
    job: JobContext,
    run: CalibrationRun,
    store: CalibrationStore,
    outcome: CalibrationOutcome,
    proof: Proof | None,
    on_calibrated: Callable[[CalibrationRecord], None],
    on_boards: ShowBoards,
) -> Mapping[str, Any]:
    from app.jobs.calibrate_solve import with_findings

    record = outcome.record
    is_whole = bool(record.lasers) and record.axis is not None
    in_use = is_whole and not (outcome.doubts and _has_better(store))
    path = store.save(record, is_current=in_use)
    write_report(with_findings(outcome, proof), path.with_suffix(".html"))
    replace(run.order, calibration=path.stem).save()
    if in_use:
        on_calibrated(CalibrationRecord.load(path))
        on_boards(run.order.board, boards_of(run.order.board, views_on_disk(run.folder), record.camera))
    for sentence in (*outcome.notes, *outcome.doubts):
        job.say(sentence)
    run.solved(outcome)
    expected = record.expected_error_mm
    return {
        "calibration": path.stem,
        "session": run.order.folder.name,
        "kind": run.order.kind.value,
        "in_use": in_use,
        "expected_error_mm": expected if np.isfinite(expected) else None,
        "proof": None if proof is None else proof.as_json(),
        "notes": list(outcome.notes),
        "doubts": list(outcome.doubts),
        "left_out": [{"view": name, "reason": why} for name, why in outcome.dropped],
    }


def _has_better(store: CalibrationStore) -> bool:
    """Whether a calibration that a scan can use is in use already."""
    try:
        record = store.current()
    except CalibrationFileError:
        return False
    return bool(record.lasers) and record.axis is not None


def _put_aside(folder: Path) -> None:
    if not folder.is_dir():
        return
    number = 1
    while (aside := folder.with_name(f"{folder.name}-{number}")).exists():
        number += 1
    try:
        folder.rename(aside)
    except OSError as error:
        raise OutputError(str(folder), reason(error)) from error
