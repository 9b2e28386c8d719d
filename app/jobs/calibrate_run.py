"""A calibration while it is made: turns what happens into states, and what people want into answers."""

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from app.calibration.capture_camera import CameraLimits
from app.calibration.capture_events import Ask, CaptureEvent, EventKind, Request, Task
from app.calibration.coverage import Coverage
from app.calibration.outcome import CalibrationOutcome
from app.calibration.struck import Struck
from app.errors import NotNow, NotThere
from app.geometry.arrays import Pixels
from app.jobs.calibrate_order import PLACEMENTS, CalibrationOrder
from app.jobs.calibrate_state import Arrow, CalibrationState, Instruction, Sight, Spot, Step, ViewState
from app.jobs.calibrate_views import TakenView, views_on_disk
from app.jobs.runner import JobContext

RECORDING_FOLDER = "recording"
# A page is not told of every picture of the camera.
_TELL_EVERY_S = 0.12
_WAIT_TICK_S = 0.1
_WAIT = Instruction("wait", "Wait: the scanner works.")
_DONE = Instruction("done", "The calibration is ready.")
_SIGHTS = {
    EventKind.UNSEEN: Sight.UNSEEN,
    EventKind.MOVING: Sight.MOVING,
    EventKind.SEEN: Sight.STILL,
    EventKind.TAKEN: Sight.TAKEN,
}
_ASKED = {
    Task.HOLD_BOARD: (Step.CAMERA, "hold-board"),
    Task.SHOW_LASERS: (Step.LASERS, "show-lasers"),
    Task.PLACE_BOARD: (Step.BOARD, "place-board"),
    Task.CLEAR_TABLE: (Step.TABLE, "clear-table"),
}


class CalibrationRun:
    """What a job and the people who watch it share. The job's thread tells; any thread asks and wishes.

    Args:
        order: what is done.
        size: of the camera's pictures.
        on_change: told every new state, in the thread that caused it; must not wait for anything.
        hands: does what a person is asked for, where no person does.

    Attributes:
        order: what is done.
        folder: of the recording.
        struck: views that are left out.
    """

    def __init__(
        self,
        order: CalibrationOrder,
        size: tuple[int, int],
        on_change: Callable[[CalibrationState], None],
        hands: Ask | None = None,
    ) -> None:
        self.order, self.folder = order, order.folder / RECORDING_FOLDER
        self.struck = Struck.load(self.folder)
        self._size, self._on_change, self._hands = size, on_change, hands
        self._lock = threading.RLock()
        self._is_ready, self._is_wanted = threading.Event(), threading.Event()
        self._taken: tuple[TakenView, ...] = views_on_disk(self.folder)
        self._rms_px: dict[int, float] = {}
        self._left_out: dict[int, str] = {}
        self._told_s = 0.0
        self._job: JobContext | None = None
        self._state = CalibrationState(
            "", order.folder.name, order.kind, order.steps, order.steps[0], 0.0, _WAIT,
            waits_for_person=False, may_continue=False, may_take=False, sight=Sight.UNKNOWN, outline=(),
            arrow=None, said="", coverage=(), coverage_share=0.0, views=(), taken=0,
            width=size[0], height=size[1],
        )  # fmt: skip
        self._change(tells=False, **self._so_far())

    @property
    def state(self) -> CalibrationState:
        """As it is now."""
        with self._lock:
            return self._state

    @property
    def limits(self) -> CameraLimits:
        """Of the camera's views: they end, or one is taken, when somebody says so."""
        return CameraLimits(is_enough=lambda: _took(self._is_ready), is_wanted=lambda: _took(self._is_wanted))

    # What people want, from any thread.

    def go_on(self) -> CalibrationState:
        """What was asked for is done, or the camera's views are enough.

        Raises:
            NotNow: nothing waits.
        """
        if not self.state.may_continue:
            raise NotNow("The calibration does not wait for anybody.", "Follow what it says.")
        self._is_ready.set()
        return self.state

    def take(self) -> CalibrationState:
        """Take a view now.

        Raises:
            NotNow: views are not taken by hand at this step.
        """
        state = self.state
        if not state.may_take:
            raise NotNow("No view can be taken by hand now.", "It can where the board is held in the hands.")
        (self._is_ready if state.step is Step.LASERS else self._is_wanted).set()
        return state

    def strike(self, number: int, *, is_struck: bool) -> CalibrationState:
        """Leave a view out, or use it after all.

        Raises:
            NotThere: there is no such view.
            OutputError: the disk is full.
        """
        with self._lock:
            if all(view.number != number for view in self._taken):
                raise NotThere(f"There is no view {number}.")
            if is_struck:
                self.struck.strike(number)
            else:
                self.struck.take_back(number)
            self._change(**self._so_far())
            return self._state

    # What happens, told by the thread of the job.

    def begin(self, job: JobContext) -> None:
        """The job has begun; it is looked at for pauses and cancellation from now on."""
        self._job = job
        job.on_cancel(self._is_ready.set)
        self._change(job_id=job.id)

    def ask(self, request: Request) -> None:
        """Has it done, by hands or by a person; returns when it is. Raises JobCancelled."""
        job = self._working()
        job.checkpoint()
        step, code = _ASKED[request.task]
        if request.task is Task.PLACE_BOARD and request.number > 0:
            code = "place-board-again"
        if request.task is Task.PLACE_BOARD and request.number >= PLACEMENTS:
            step = Step.PROOF
        asked = Instruction(code, request.words, problem=request.problem)
        is_held = request.task is Task.HOLD_BOARD
        self._enter(step, asked, may_take=is_held)
        self._is_ready.clear()
        if self._hands is not None:
            self._hands(request)
        elif not is_held:
            self._wait_for(job, asked, may_take=request.task is Task.SHOW_LASERS)
        self._change(
            instruction=asked if is_held else _WAIT, waits_for_person=False, may_continue=is_held,
            may_take=is_held,
        )  # fmt: skip

    def watch(self, event: CaptureEvent) -> None:
        """What the capture tells. Raises JobCancelled."""
        job = self._working()
        changes: dict[str, Any] = {"done": event.done, "said": event.words, "step": Step(event.stage)}
        if event.kind in _SIGHTS:
            changes |= {"sight": _SIGHTS[event.kind], "outline": self._spots(_box(event.corners))}
        if event.kind is EventKind.WANTED and event.wish is not None:
            wish = event.wish
            changes["instruction"] = Instruction(wish.code, f"Please {wish.words}.", wish.target)
        elif event.kind is EventKind.WAITING:
            job.waits(event.words)
            changes["instruction"] = Instruction("device-away", event.words)
        elif event.kind is EventKind.GOING_ON:
            job.waits("")
            changes["instruction"] = _WAIT
        elif event.kind is EventKind.RATED:
            self._rms_px = dict(event.rms_px)
            changes |= self._so_far()
        elif event.kind is EventKind.TAKEN and event.view is not None:
            self._taken = views_on_disk(self.folder)
            changes |= self._so_far() | {"taken": self.state.taken + 1}
        is_news = event.kind not in (EventKind.UNSEEN, EventKind.MOVING, EventKind.SEEN, EventKind.TURNING)
        self._change(tells=is_news, **changes)
        job.progress(*self._progress(), event.words)
        job.checkpoint()

    def solving(self, stage: str, done: int, total: int | None) -> None:
        """What the solver tells. Raises JobCancelled."""
        step = Step.PROVING if stage.startswith("Proving") else Step.SOLVING
        share = done / total if total else 0.0
        self._change(
            step=step, done=share, instruction=_WAIT, said=stage, may_continue=False, may_take=False,
            sight=Sight.UNKNOWN, outline=(), tells=self.state.step is not step,
        )  # fmt: skip
        job = self._working()
        job.progress(*self._progress(), stage)
        job.checkpoint()

    def solved(self, outcome: CalibrationOutcome) -> None:
        """The calibration is there: how well each view fits is known for good."""
        numbers = {view.file: view.number for view in self._taken}
        fits = {numbers[v.name]: v.corner_px for v in outcome.views if v.name in numbers}
        self._rms_px |= {number: rms for number, rms in fits.items() if np.isfinite(rms)}
        self._left_out = {numbers[name]: why for name, why in outcome.dropped if name in numbers}
        self._change(step=Step.DONE, done=1.0, instruction=_DONE, **self._so_far())

    def rest(self) -> None:
        """The job has ended, however."""
        self._change(
            waits_for_person=False, may_continue=False, may_take=False, sight=Sight.UNKNOWN, outline=()
        )

    def _wait_for(self, job: JobContext, asked: Instruction, *, may_take: bool) -> None:
        self._change(waits_for_person=True, may_continue=True, may_take=may_take)
        job.waits(asked.words)
        try:
            while not self._is_ready.wait(_WAIT_TICK_S):
                job.checkpoint()
            self._is_ready.clear()
            job.checkpoint()
        finally:
            job.waits("")

    def _enter(self, step: Step, instruction: Instruction, *, may_take: bool) -> None:
        self._change(
            step=step, done=0.0, instruction=instruction, may_take=may_take, sight=Sight.UNKNOWN, outline=()
        )

    def _progress(self) -> tuple[int, int]:
        """In hundredths of all steps, each counted alike."""
        state = self.state
        steps = len(state.steps) - 1
        before = state.steps.index(state.step) if state.step in state.steps else 0
        return round(100.0 * (before + min(state.done, 1.0))), 100 * steps

    def _so_far(self) -> dict[str, Any]:
        """Views and coverage."""
        struck = self.struck.reasons
        views = tuple(self._shown(view, struck) for view in self._taken)
        is_held = Step.CAMERA in self.order.steps
        counted = [
            view.corners
            for view in self._taken
            if view.number not in struck and (view.step is Step.CAMERA or not is_held)
        ]
        coverage = Coverage.of(counted, self._size)
        counts = tuple(tuple(int(count) for count in row) for row in coverage.counts)
        return {"views": views, "coverage": counts, "coverage_share": coverage.share}

    def _shown(self, view: TakenView, struck: Mapping[int, str]) -> ViewState:
        reason = struck.get(view.number) or self._left_out.get(view.number, "")
        return ViewState(
            view.number, view.step, view.pose, view.angle_deg, len(view.corners), self._spots(view.outline),
            self._rms_px.get(view.number), view.number in struck, reason,
        )  # fmt: skip

    def _spots(self, pixels: Pixels) -> tuple[Spot, ...]:
        return tuple((float(u) / self._size[0], float(v) / self._size[1]) for u, v in pixels)

    def _change(self, *, tells: bool = True, **changes: Any) -> None:
        """Another state; nobody is told where it is no news and they were told a moment ago."""
        with self._lock:
            changed = replace(self._state, **changes)
            self._state = replace(changed, arrow=_arrow(changed))
            now_s = time.monotonic()
            if not (tells or now_s - self._told_s > _TELL_EVERY_S) or not self._state.job_id:
                return
            self._told_s = now_s
            state = self._state
        self._on_change(state)

    def _working(self) -> JobContext:
        if self._job is None:
            raise NotNow("The calibration has not begun.")
        return self._job


def _took(event: threading.Event) -> bool:
    """Whether it was set; it is not any more."""
    was_set = event.is_set()
    event.clear()
    return was_set


def _box(corners: Pixels) -> Pixels:
    """The outermost of some corners, (4, 2), in the order of a walk around."""
    if len(corners) < 4:
        return np.zeros((0, 2))
    along, across = corners.sum(axis=1), corners[:, 0] - corners[:, 1]
    ends = [np.argmin(along), np.argmax(across), np.argmax(along), np.argmin(across)]
    return corners[ends]


def _arrow(state: CalibrationState) -> Arrow | None:
    """From where the board is to where it should be; none where either is unknown, or it is there."""
    target = state.instruction.target
    if target is None or not state.outline:
        return None
    middle = np.mean(state.outline, axis=0)
    if float(np.linalg.norm(middle - target)) < 0.05:
        return None
    return Arrow((float(middle[0]), float(middle[1])), target)
