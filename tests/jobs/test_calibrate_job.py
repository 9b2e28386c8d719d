"""A calibration as people see it while it is made: what to do next, what was taken, what is left out."""

import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.calibration.capture_camera import CameraLimits
from app.calibration.capture_events import CaptureEvent, EventKind, Request, Task
from app.calibration.capture_goals import Wish
from app.calibration.capture_views import seen_json
from app.calibration.record import CalibrationRecord
from app.calibration.struck import Struck
from app.errors import CalibrationError, NotNow, NotThere, OptionError
from app.geometry.camera import CameraIntrinsics
from app.jobs.calibrate import redo
from app.jobs.calibrate_order import CalibrationOrder, board_as_measured
from app.jobs.calibrate_run import RECORDING_FOLDER, CalibrationRun
from app.jobs.calibrate_state import CalibrationState, Kind, Sight, Step
from app.jobs.events import EventBus
from app.jobs.job import JobState
from app.jobs.runner import JobContext, JobRunner
from app.recording.manifest import Header
from app.recording.picture import encode
from app.recording.reader import Recording
from app.recording.shot import Role
from app.recording.writer import RecordingWriter
from app.vision.board import BoardObservation, BoardSpec

_SIZE = (64, 48)
_BOARD = BoardSpec("chessboard", 4, 3, 10.0)
_NOWHERE = np.zeros((0, 2))
_CORNERS = np.array([[u, v] for v in (10.0, 20.0, 30.0) for u in (10.0, 20.0, 30.0, 40.0)])
_SEEN = BoardObservation(np.arange(12), _CORNERS, _BOARD.points())


def _order(folder: Path, kind: Kind = Kind.FULL) -> CalibrationOrder:
    return CalibrationOrder(folder / "session", kind, _BOARD)


def _taken(folder: Path) -> None:
    """Two views of the camera, and two stops of a board on the table with one laser."""
    header = Header.of(_SIZE, {"left": "red"}, board=_BOARD)
    picture = encode(np.zeros((48, 64, 3), np.uint8), "png")
    with RecordingWriter.create(folder / RECORDING_FOLDER, header) as writer:
        for _ in range(2):
            writer.append_encoded(picture, Role.INTRINSICS, extra=seen_json(_SEEN))
        for angle in (0.0, 10.0):
            writer.append_encoded(picture, Role.AXIS, (), angle, pose=0, extra=seen_json(_SEEN))
            writer.append_encoded(picture, Role.AXIS, ("left",), angle, pose=0)


def _event(kind: EventKind, words: str = "so", **more: Any) -> CaptureEvent:
    return CaptureEvent(kind, words, "camera", 0.5, 2, more.pop("corners", _NOWHERE), **more)


class _Job:
    """Does something with a run in a job of its own, and keeps the states."""

    def __init__(self, folder: Path, order: CalibrationOrder) -> None:
        self.states: list[CalibrationState] = []
        self.run = CalibrationRun(order, _SIZE, self.states.append)
        self._runner = JobRunner(folder / "jobs", EventBus())

    def start(self, what: Callable[[CalibrationRun], None]) -> str:
        def work(job: JobContext) -> Mapping[str, Any]:
            self.run.begin(job)
            try:
                what(self.run)
            finally:
                self.run.rest()
            return {}

        return self._runner.submit("calibrate", "Calibration", work, needs_bench=True).id

    def wait(self, is_so: Callable[[], bool]) -> None:
        ends = time.monotonic() + 60.0
        while not is_so():
            assert time.monotonic() < ends, "it never came to be"
            threading.Event().wait(0.01)

    def state_of(self, job_id: str) -> JobState:
        return self._runner.job(job_id).state

    def done(self, what: Callable[[CalibrationRun], None]) -> None:
        job_id = self.start(what)
        self.wait(lambda: self.state_of(job_id).has_ended)
        assert self.state_of(job_id) is JobState.DONE, self._runner.lines(job_id)

    def cancel(self, job_id: str) -> None:
        self._runner.cancel(job_id)


def test_what_to_do_next_is_told_in_words_as_a_code_and_as_an_arrow(tmp_path: Path) -> None:
    job = _Job(tmp_path, _order(tmp_path))
    wish = Wish("move-top-left", "bring the board to the top left corner of the picture", (1 / 6, 1 / 6))

    def happens(run: CalibrationRun) -> None:
        run.watch(_event(EventKind.WANTED, wish.words, wish=wish))
        run.watch(_event(EventKind.SEEN, corners=_CORNERS))
        assert run.state.instruction.code == "move-top-left"
        assert run.state.instruction.words == f"Please {wish.words}."
        assert run.state.sight is Sight.STILL
        arrow = run.state.arrow
        assert arrow is not None
        assert arrow.head == (1 / 6, 1 / 6)
        assert arrow.tail == pytest.approx((25 / 64, 20 / 48))
        run.watch(_event(EventKind.UNSEEN))
        assert run.state.arrow is None

    job.done(happens)
    assert all(state.job_id for state in job.states)
    assert job.run.state.sight is Sight.UNKNOWN


def test_a_job_waits_for_its_person_and_goes_on_when_told(tmp_path: Path) -> None:
    job = _Job(tmp_path, _order(tmp_path, Kind.AUTOMATIC))
    with pytest.raises(NotNow):
        job.run.go_on()
    job_id = job.start(lambda run: run.ask(Request(Task.PLACE_BOARD, 1, "Stand it there.")))
    job.wait(lambda: job.run.state.waits_for_person)
    assert job.run.state.instruction.code == "place-board-again"
    with pytest.raises(NotNow):
        job.run.take()
    job.run.go_on()
    job.wait(lambda: job.state_of(job_id) is JobState.DONE)
    assert not job.run.state.waits_for_person


def test_a_job_that_waits_can_be_cancelled(tmp_path: Path) -> None:
    job = _Job(tmp_path, _order(tmp_path, Kind.AUTOMATIC))
    job_id = job.start(lambda run: run.ask(Request(Task.CLEAR_TABLE, 0, "Take it away.")))
    job.wait(lambda: job.run.state.waits_for_person)
    job.cancel(job_id)
    job.wait(lambda: job.state_of(job_id) is JobState.CANCELLED)
    assert not job.run.state.may_continue


def test_a_held_board_is_taken_when_asked_for_and_ended_when_it_is_enough(tmp_path: Path) -> None:
    job = _Job(tmp_path, _order(tmp_path))

    def happens(run: CalibrationRun) -> None:
        run.ask(Request(Task.HOLD_BOARD, 0, "Hold it."))
        limits = run.limits
        assert not limits.is_wanted()
        run.take()
        assert limits.is_wanted()
        assert not limits.is_wanted()
        run.go_on()
        assert limits.is_enough()

    job.done(happens)


def test_what_was_taken_is_known_after_a_restart_and_can_be_struck_out(tmp_path: Path) -> None:
    order = _order(tmp_path)
    order.save()
    _taken(order.folder)
    run = CalibrationRun(CalibrationOrder.load(order.folder), _SIZE, lambda state: None)
    views = run.state.views
    assert [(view.number, view.step) for view in views] == [
        (0, Step.CAMERA), (1, Step.CAMERA), (2, Step.BOARD), (4, Step.BOARD),
    ]  # fmt: skip
    assert all(view.corners == 12 for view in views)
    assert views[0].outline[0] == pytest.approx((10 / 64, 10 / 48))
    assert sum(map(sum, run.state.coverage)) == 24
    run.strike(0, is_struck=True)
    run.strike(4, is_struck=True)
    with pytest.raises(NotThere):
        run.strike(3, is_struck=True)
    assert sum(map(sum, run.state.coverage)) == 12
    recording = Recording.open(order.folder / RECORDING_FOLDER)
    struck = Struck.load(order.folder / RECORDING_FOLDER)
    assert [entry.angle_deg for entry in struck.kept(recording).entries] == [None, 0.0, 0.0]
    run.strike(4, is_struck=False)
    struck = Struck.load(order.folder / RECORDING_FOLDER)
    struck.strike_bad({4: "it does not fit", 1: "it does not fit"})
    # What a person has taken back stays.
    assert set(struck.reasons) == {0, 1}


def test_a_step_is_redone_without_deleting_anything(tmp_path: Path) -> None:
    order = _order(tmp_path)
    _taken(order.folder)
    recording = order.folder / RECORDING_FOLDER
    (recording / "proof").mkdir()
    before = sorted(path.name for path in (recording / "frames").iterdir())
    redo(order.folder, Step.BOARD)
    assert set(Struck.load(recording).reasons) == {2, 3, 4, 5}
    assert not (recording / "proof").exists()
    assert (recording / "proof-1").is_dir()
    assert sorted(path.name for path in (recording / "frames").iterdir()) == before
    redo(order.folder, Step.SOLVING)
    with pytest.raises(OptionError, match="done"):
        redo(order.folder, Step.DONE)


def test_every_kind_knows_its_steps_and_what_it_takes(tmp_path: Path) -> None:
    steps = {kind: _order(tmp_path, kind).steps for kind in Kind}
    assert Step.CAMERA not in steps[Kind.AUTOMATIC]
    assert steps[Kind.CAMERA] == (Step.CAMERA, Step.SOLVING, Step.DONE)
    assert Step.LASERS in steps[Kind.PAPER]
    plan = _order(tmp_path, Kind.CAMERA).capture_plan(CameraLimits())
    assert (plan.placements, plan.with_proof, plan.with_camera) == (0, False, True)
    assert _order(tmp_path, Kind.PAPER).calibration_plan().method == "paper"
    with pytest.raises(CalibrationError, match="camera is not calibrated"):
        _order(tmp_path, Kind.TABLE).calibration_plan()


def test_an_order_is_read_as_it_was_kept(tmp_path: Path) -> None:
    camera = CameraIntrinsics(np.array([[60.0, 0, 32], [0, 60, 24], [0, 0, 1]]), np.zeros(5), _SIZE)
    order = CalibrationOrder(
        tmp_path / "s",
        Kind.TABLE,
        board_as_measured(_BOARD, 99.0),
        CalibrationRecord(camera=camera),
        "simulated",
    )
    order.save()
    there = CalibrationOrder.load(order.folder)
    assert (there.kind, there.hands, there.board.spacing_mm) == (Kind.TABLE, "simulated", 9.9)
    assert there.calibration_plan().camera is not None
