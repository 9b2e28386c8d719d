"""Each kind of job in a dozen lines."""

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from app.calibration.platter_file import layout_of
from app.calibration.record import CalibrationRecord
from app.checkup.checkup import checkup, chosen
from app.checkup.examination import Examination
from app.devices.bench import Bench
from app.errors import OutputError, PositionUnknown, ScannerError, TurnBrokenOff
from app.jobs.estimate import pace_of
from app.jobs.events import PointsAdded
from app.jobs.runner import JobContext, Work
from app.jobs.scan_log import ScanLog
from app.jobs.scan_parts import check_lasers, live_points_for, recovery_for, rig_of
from app.library.again import DETECTOR, reconstruct_again
from app.library.library import Library
from app.recording.manifest import FrameEntry
from app.recording.reader import Recording
from app.scanning.drift import DriftReference
from app.scanning.exposure_stack import check_exposures
from app.scanning.live import LivePoints
from app.scanning.plan import ScanPlan
from app.scanning.profile import Profile
from app.scanning.reconstruct import ReconstructionOptions
from app.scanning.run import Recovery, place_table, run_scan
from app.scanning.scan import Taken
from app.scanning.session import ScanSession
from app.scanning.sources import reconstruct_recording, scan_detector
from app.surface.ply import PlyWriter
from app.surface.preview import PreviewPainter

CALIBRATION_FILE, CLOUD_FILE = "calibration.json", "cloud.ply"
_GO_ON_HINT = "What was taken is kept. Free some space, or make the disk writable; then go on with the scan."


@dataclass(frozen=True, slots=True)
class ScanOrder:
    """A scan that somebody wants.

    Attributes:
        folder: of its recording; new, or of an unfinished scan where `plan` is None.
        plan: what to do; None to go on with what was begun.
        bench_spec: what names the bench.
        patience_s: how long to wait for a device that goes away.
        takes_target: go on even where nobody can tell where an interrupted move ended.
        detector: finds the stripes.
        options: how the pictures become points.
    """

    folder: Path
    plan: ScanPlan | None
    bench_spec: str
    patience_s: float = 600.0
    takes_target: bool = False
    detector: str = DETECTOR
    options: ReconstructionOptions = field(default_factory=ReconstructionOptions)


def scan_work(
    bench: Bench,
    order: ScanOrder,
    calibration: CalibrationRecord | None,
    on_profile: Callable[[Profile], None] | None = None,
    on_begin: Callable[[], None] | None = None,
) -> Work:
    """Scan; then, where there is a calibration, the cloud beside the recording.

    A scan that is gone on with keeps the calibration that it was begun with, where it had one.
    """

    def work(job: JobContext) -> Mapping[str, Any]:
        record = _own(order) or calibration
        session = _begun(bench, order, record)
        shots_before, log = session.shots, ScanLog(order.folder)
        with ExitStack() as stack:
            # Whatever fails before the first picture: others may have the recording again.
            stack.callback(session.writer.suspend)
            if record is not None and not (order.folder / CALIBRATION_FILE).is_file():
                record.save(order.folder / CALIBRATION_FILE)
            recovery = recovery_for(session, record, bench, order.patience_s)
            if order.plan is None:
                _place(bench, session, recovery, takes_target=order.takes_target)
            # A cancelled scan need not end its move.
            job.on_cancel(bench.make_safe)
            if on_begin is not None:
                on_begin()
            stack.enter_context(log.following(session, record, bench.description.name))
            live = live_points_for(session, record, bench, on_profile, order.detector, order.options)
            if live is not None:
                stack.enter_context(live)
            watch = _ScanWatch(job, session, live, log)
            watch.begin()
            try:
                recording = run_scan(bench, session, watch, recovery)
            except OutputError as error:
                raise OutputError(error.where, error.problem, _GO_ON_HINT) from error
        captured_s = job.active_s
        log.note(
            f"All pictures are taken: {session.shots}, the last {session.shots - shots_before} "
            f"in {captured_s:.1f} s."
        )
        if live is not None and live.problem:
            log.note(f"No live points: {live.problem}")
        pace = pace_of(session, shots_before, captured_s)
        result: dict[str, Any] = {"folder": str(order.folder), "pictures": len(recording.entries)}
        if rig_of(record) is not None and record is not None:
            result |= _reconstructed(job, recording, record, order, log)
            changes = {"points": result["points"], "computing_s": job.active_s - captured_s}
            pace = pace.model_copy(update=changes)
        return result | {"pace": pace.model_dump(mode="json")}

    return work


def reconstruct_work(
    library: Library,
    name: str,
    record: CalibrationRecord | None,
    detector: str = DETECTOR,
    options: ReconstructionOptions | None = None,
) -> Work:
    """Another cloud of a scan in the library; those it has stay. Arguments as of `reconstruct_again`."""

    def work(job: JobContext) -> Mapping[str, Any]:
        def progress(done: int, total: int, points: int) -> None:
            job.checkpoint()
            job.progress(done, total, f"{points} points")

        again = reconstruct_again(library, name, record, detector, options, progress)
        report = again.report
        return {
            "cloud": again.cloud.name, "points": report.points, "doubts": list(report.doubts),
            "drift": report.drift.as_json(),
        }  # fmt: skip

    return work


def checkup_work(bench: Bench, names: Sequence[str], scans: Path, record: CalibrationRecord | None) -> Work:
    """The doctor."""

    def work(job: JobContext) -> Mapping[str, Any]:
        def progress(words: str, done: int, total: int) -> None:
            job.checkpoint()
            job.progress(done, total, words)

        bench.connect()
        return checkup(Examination(bench, scans, record), chosen(names), progress).as_json()

    return work


class _ScanWatch:
    """Tells the job how the scan goes, and lets it rest between pictures."""

    def __init__(self, job: JobContext, session: ScanSession, live: LivePoints | None, log: ScanLog) -> None:
        self.job, self.session, self.live, self.log = job, session, live, log

    def begin(self) -> None:
        """What a scan has already that is gone on with is no pace."""
        self._tell()

    def taken(self, taken: Taken, entry: FrameEntry) -> None:
        session = self.session
        if self.live is not None:
            self.live.add(taken)
            self.job.bus.publish(PointsAdded(self.job.id, self.live.points))
        self._tell(f"stop {taken.stop + 1} of {session.plan.steps}")
        if session.plan.mode == "step":
            self._rest()
        elif self.job.is_to_rest:
            # A table cannot rest in mid-turn: the turn is broken off, and taken up again later.
            raise TurnBrokenOff("the scan", "rests")

    def waiting(self, problem: str) -> None:
        if not self.job.is_to_rest:
            self.job.say(problem)
            self.job.waits(problem)
            self.log.note(f"Waits for a device after {self.session.shots} pictures: {problem}.")
        self._rest()

    def going_on(self) -> None:
        self.job.waits("")
        self.log.note("The scan goes on.")

    def _rest(self) -> None:
        if not self.job.is_to_rest:
            return
        began_s = time.monotonic()
        self.job.checkpoint()
        rested_s = time.monotonic() - began_s
        self.log.note(f"Was paused for {rested_s:.0f} s, after {self.session.shots} pictures.")

    def _tell(self, note: str = "") -> None:
        session = self.session
        if session.plan.mode == "step":
            self.job.progress(session.shots, session.plan.shots, note)
        else:
            turned = session.plan.turn_deg * len(session.plan.passes)
            self.job.progress(round(turned * session.done), round(turned), "turning")


def _own(order: ScanOrder) -> CalibrationRecord | None:
    path = order.folder / CALIBRATION_FILE
    return CalibrationRecord.load(path) if order.plan is None and path.is_file() else None


def _begun(bench: Bench, order: ScanOrder, record: CalibrationRecord | None) -> ScanSession:
    if order.plan is None:
        # Where the table stands is found out below.
        with suppress(PositionUnknown):
            bench.connect()
        return ScanSession.resume(order.folder)
    try:
        bench.connect()
        check_lasers(bench, order.plan.lasers, record)
        check_exposures(order.plan, bench.camera)
    except ScannerError:
        # A folder that was reserved for a scan that cannot begin is of no use.
        with suppress(OSError):
            order.folder.rmdir()
        raise
    return ScanSession.create(order.folder, order.plan, bench, order.bench_spec)


def _place(bench: Bench, session: ScanSession, recovery: Recovery, *, takes_target: bool) -> None:
    """As long as this program counts angles from the zero of the scan, it knows where the table stands."""
    is_same_zero = session.zero == bench.zero_name
    if is_same_zero and bench.is_placed:
        return
    if not is_same_zero:
        bench.restore(session.table.angle_deg)
    place_table(bench, session, recovery, takes_target=takes_target)


def _reconstructed(
    job: JobContext, recording: Recording, record: CalibrationRecord, order: ScanOrder, log: ScanLog
) -> Mapping[str, Any]:
    cloud = order.folder / CLOUD_FILE
    run = reconstruct_recording(
        recording,
        record.rig,
        scan_detector(order.detector, order.options.threshold),
        order.options,
        layout_of(record) or None,
        DriftReference.kept_in(record.extra),
    )
    painter = PreviewPainter()
    with PlyWriter(cloud, run.laser_names) as ply:
        for number, profile in enumerate(run, start=1):
            job.checkpoint()
            ply.append(profile.cloud)
            painter.add(profile.cloud)
            job.progress(number, run.total, "reconstructing")
    painter.write(cloud.with_suffix(".png"))
    report = run.report()
    sentences = (*report.warnings, *report.doubts)
    for sentence in sentences:
        job.say(sentence)
    log.note(" ".join([f"Computed {CLOUD_FILE} with {order.detector}: {report.points} points.", *sentences]))
    return {
        "cloud": str(cloud), "points": report.points, "doubts": list(report.doubts),
        "drift": report.drift.as_json(),
    }  # fmt: skip
