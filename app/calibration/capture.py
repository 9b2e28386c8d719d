"""All pictures of a calibration, taken on the bench: camera, lasers and axis, proof, empty table."""

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np

from app.calibration.capture_camera import FEWEST_VIEWS, STAGE, CameraLimits, capture_camera_views
from app.calibration.capture_events import Ask, CaptureEvent, EventKind, Request, Task, Watch
from app.calibration.capture_session import CaptureSession
from app.calibration.capture_table import Span, TableCapture
from app.calibration.struck import Struck
from app.devices.bench import Bench
from app.errors import (
    CalibrationError,
    DeviceError,
    DeviceRefused,
    MoveStopped,
    OptionError,
    PositionUnknown,
)
from app.recording.journal import JOURNAL_FILE, MANIFEST_FILE
from app.recording.reader import Recording
from app.vision.board import BoardSpec

T = TypeVar("T")

PROOF_FOLDER = "proof"
# Devices that fail so often are not worth another try; neither is a board that is not found.
_TRIES, _PLACE_TRIES = 4, 3
_EMPTY_STOPS = 12
_PLACES = (
    "Stand the board on the table, facing the camera, a few centimetres before the middle.",
    "Stand the board in another place: a few centimetres behind the middle, facing the camera.",
)
_BEFORE_LASERS = (
    "Put the board where the lasers will cross it, each time nearer, further or turned otherwise, and keep "
    "it still."
)


@dataclass(frozen=True, slots=True)
class CapturePlan:
    """What is taken.

    Attributes:
        with_camera: views of a board that is held by hand; not where the camera is known.
        laser_poses: of a board that is put anywhere before the lasers, each when somebody says so.
        placements: of the board on the table.
        with_proof: pictures that the calibration does not use, to try it on.
        with_empty_table: the table alone, which tells how high it is; needless where markers lie on it.
        limits: of the camera views.
        patience_s: how long to wait for a device that has gone away.
    """

    with_camera: bool = True
    laser_poses: int = 0
    placements: int = 2
    with_proof: bool = True
    with_empty_table: bool = True
    limits: CameraLimits = field(default_factory=CameraLimits)
    patience_s: float = 60.0


@dataclass(frozen=True, eq=False, slots=True)
class Captured:
    """What was taken.

    Attributes:
        recording: to calibrate from.
        proof: to try the calibration on; None where none was wanted.
    """

    recording: Recording
    proof: Recording | None


def capture(
    bench: Bench, folder: Path, board: BoardSpec, ask: Ask, watch: Watch, plan: CapturePlan, *,
    resumes: bool = False, struck: Struck | None = None,
) -> Captured:  # fmt: skip
    """Take everything; on every way out the bench is safe and what was taken is kept.

    Args:
        bench: connected; leased here.
        folder: of the recording, new or empty; the proof's lies in it.
        board: that will be shown.
        ask: has a person do what is needed.
        watch: told how it goes, in this thread.
        plan: see there.
        resumes: go on with the recording that is in the folder.
        struck: views of it that are left out, where somebody else decides about them, too.

    Raises:
        OptionError: this bench cannot be calibrated so.
        CalibrationError: the board was not seen, or too seldom.
        DeviceError: a device failed and did not come back.
        OutputError: the disk is full.
    """
    _check(bench, plan)
    begin = CaptureSession.resume if resumes else CaptureSession.create
    session = begin(folder, bench, board, struck)
    try:
        with bench.lease("a calibration"):
            proof = _Run(bench, session, ask, watch, plan).all()
        return Captured(session.struck.kept(session.finish()), proof)
    except BaseException:
        session.suspend()
        raise


def _check(bench: Bench, plan: CapturePlan) -> None:
    if plan.placements == 0 and plan.laser_poses == 0:
        return
    if bench.turntable.facts.turns_by_itself:
        raise OptionError(
            "This table turns by itself and cannot stop for the pictures of a calibration.",
            "Take the pictures by hand and calibrate from recordings; see docs/calibrating.md.",
        )
    if not bench.lasers:
        raise OptionError("The bench has no laser.", "List its lasers in the bench file.")


class _Run:
    """One run through the stages."""

    def __init__(
        self, bench: Bench, session: CaptureSession, ask: Ask, watch: Watch, plan: CapturePlan
    ) -> None:
        self.bench, self.session, self.ask, self.watch, self.plan = bench, session, ask, watch, plan
        self._stage = STAGE

    def all(self) -> Recording | None:
        """Every stage that is wanted and not there yet; the proof."""
        has_begun_with_table = self.session.next_pose > 0 and self.session.camera_views >= FEWEST_VIEWS
        if self.plan.with_camera and not has_begun_with_table:
            self._camera_views()
        while self.session.laser_poses < self.plan.laser_poses:
            self._laser_pose()
        standing: Span | None = None
        while self.session.placements < self.plan.placements:
            standing = self._placement(self.session, "board", self.session.placements)
        proof = self._proof(standing) if self.plan.with_proof else None
        is_wanted = self.plan.with_empty_table and self.bench.description.platter is None
        if is_wanted and self.session.empty_stops < _EMPTY_STOPS:
            self._empty_table()
        return proof

    def _camera_views(self) -> None:
        views = self.session.views()
        if views.goals.wish is None:
            return
        words = (
            "Hold the board before the camera, all of it in the picture. Pictures are taken by themselves."
        )
        self.ask(Request(Task.HOLD_BOARD, 0, words))
        self._persist(
            lambda: capture_camera_views(self.bench, self.session, views, self.watch, self.plan.limits)
        )

    def _laser_pose(self) -> None:
        """One more pose of the board before the lasers; asked for again until it is seen."""
        self._stage, problem = "lasers", ""
        there, wanted = self.session.laser_poses, self.plan.laser_poses
        table = TableCapture(self.bench, self.session, self.watch, self._stage)
        while self.session.laser_poses == there:
            self.ask(Request(Task.SHOW_LASERS, there, f"{problem} {_BEFORE_LASERS}".strip(), problem))
            try:
                self._persist(lambda: table.take_pose(self.session.next_pose, (there + 1) / wanted))
            except CalibrationError as error:
                problem = f"{error.message} {error.hint}"

    def _placement(self, session: CaptureSession, stage: str, number: int) -> Span:
        """The board stood on the table and photographed; where it was seen."""
        self._stage, problem = stage, ""
        place = _PLACES[number % len(_PLACES)]
        table = TableCapture(self.bench, session, self.watch, stage)
        for attempt in range(_PLACE_TRIES):
            self._persist(lambda: self.bench.turntable.move_to(0.0))
            self.ask(Request(Task.PLACE_BOARD, number, f"{problem} {place}".strip(), problem))
            try:
                return self._persist(lambda: _found_and_taken(table, session))
            except CalibrationError as error:
                if attempt == _PLACE_TRIES - 1:
                    raise
                problem = f"{error.message} {error.hint}"
        raise AssertionError("the last try returns or raises")

    def _proof(self, standing: Span | None) -> Recording:
        """Pictures at other angles than those before, where the board still stands."""
        self._stage = PROOF_FOLDER
        folder = self.session.folder / PROOF_FOLDER
        if (folder / MANIFEST_FILE).is_file() and not (folder / JOURNAL_FILE).is_file():
            return Recording.open(folder)
        begin = CaptureSession.resume if CaptureSession.is_begun(folder) else CaptureSession.create
        session = begin(folder, self.bench, self.session.board)
        try:
            if standing is None:
                self._placement(session, PROOF_FOLDER, self.plan.placements)
            else:
                table = TableCapture(self.bench, session, self.watch, PROOF_FOLDER)
                self._persist(lambda: table.take(standing.between(), session.next_pose))
            return session.finish()
        except BaseException:
            session.suspend()
            raise

    def _empty_table(self) -> None:
        self._stage = "table"
        self.ask(Request(Task.CLEAR_TABLE, 0, "Take the board off the table; nothing may stand on it."))
        table = TableCapture(self.bench, self.session, self.watch, self._stage)
        begins_deg = self.bench.turntable.angle_deg
        stops = [begins_deg + float(a) for a in np.arange(_EMPTY_STOPS) * 360.0 / _EMPTY_STOPS]
        self._persist(lambda: table.take_empty(stops))

    def _persist(self, step: Callable[[], T]) -> T:
        """Do it, and once more whenever a device went away and came back."""
        for attempt in range(_TRIES):
            try:
                return step()
            except (MoveStopped, DeviceRefused):
                raise
            except DeviceError as error:
                if attempt == _TRIES - 1:
                    raise
                self._tell(EventKind.WAITING, error.message)
                self._recover(error)
                self._tell(EventKind.GOING_ON, "it is back")
        raise AssertionError("the last try returns or raises")

    def _recover(self, error: DeviceError) -> None:
        """Devices back. Where the table stands is called by its old angle: every placement counts anew."""
        with contextlib.suppress(DeviceError):
            self.bench.make_safe()
        if isinstance(error, PositionUnknown):
            self.bench.lose_place(error)
        try:
            self.bench.recover(self.plan.patience_s, lambda words: self._tell(EventKind.WAITING, words))
        except PositionUnknown:
            self.bench.zero(self.bench.turntable.angle_deg)

    def _tell(self, kind: EventKind, words: str) -> None:
        self.watch(CaptureEvent(kind, words, self._stage, 0.0, self.session.pictures, np.zeros((0, 2))))


def _found_and_taken(table: TableCapture, session: CaptureSession) -> Span:
    span = table.find(table.bench.turntable.angle_deg)
    table.take(span, session.next_pose)
    return span
