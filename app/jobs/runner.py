"""Runs jobs in threads: one at a time on the bench, some computations beside it."""

import logging
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypeAlias
from uuid import uuid4

from app.errors import DeviceRefused, JobRuns, NotNow, NotThere, OptionError, ScannerError
from app.jobs.archive import JobArchive
from app.jobs.events import EventBus, JobChanged, JobSaid
from app.jobs.job import JobCancelled, JobProblem, JobSnapshot, JobState
from app.jobs.pace import Pace

_LINES_KEPT = 500
_ENDED_KEPT = 200
_SAVED_EVERY_S = 2.0
_LOOKS_UP_S = 0.2
_log = logging.getLogger(__name__)

Work: TypeAlias = "Callable[[JobContext], Mapping[str, Any]]"
"""Does the job and returns what it made, by name, ready for JSON."""


class JobRunner:
    """Takes jobs, runs each in a thread of its own when its turn has come, and keeps them on disk.

    Jobs of earlier runs of the program are there again; those that it did not bring to an end have failed.

    Args:
        folder: jobs are kept here, see `JobArchive`.
        bus: told every change.
        computations: how many jobs that need no bench may run at once.
        is_unfinished: whether the scan of that name in the library can be gone on with.
    """

    def __init__(
        self,
        folder: Path,
        bus: EventBus,
        *,
        computations: int = 1,
        is_unfinished: Callable[[str], bool] = lambda scan: False,
    ) -> None:
        self.bus = bus
        self._computations, self._is_unfinished = computations, is_unfinished
        self._archive = JobArchive(folder)
        self._lock = threading.RLock()
        self._saving = threading.Lock()
        self._jobs: dict[str, _Job] = {}
        self._waiting: deque[_Job] = deque()
        self._is_closed = False
        self._bring_back()

    def submit(
        self,
        kind: str,
        title: str,
        work: Work,
        *,
        needs_bench: bool,
        scan: str = "",
        order: Mapping[str, Any] | None = None,
        expected_s: float | None = None,
        on_dropped: Callable[[], None] = lambda: None,
    ) -> JobSnapshot:
        """Take a job; it begins at once, or when those before it have ended.

        Args:
            kind, title, scan, order: see `JobSnapshot`.
            work: does it.
            needs_bench: only one such job runs at a time.
            expected_s: how long its first part should take.
            on_dropped: called where it is cancelled before it has begun.
        """
        now = datetime.now(UTC)
        with self._lock:
            if self._is_closed:
                raise OptionError("The server is closing.", "Start it again.")
            number = 1 + max((job.snapshot.number for job in self._jobs.values()), default=0)
            snapshot = JobSnapshot(
                self._new_id(now), kind, title, JobState.QUEUED, now, scan=scan, order=order, number=number
            )
            job = _Job(snapshot, work, needs_bench, Pace(expected_s), expected_s, on_dropped)
            self._jobs[snapshot.id] = job
            self._waiting.append(job)
            self._changed(job)
        self._save(job)
        with self._lock:
            self._start_what_can()
        return job.snapshot

    def jobs(self) -> list[JobSnapshot]:
        """All that are known, newest first."""
        with self._lock:
            known = [job.snapshot for job in reversed(self._jobs.values())]
        return [self._shown(snapshot) for snapshot in known]

    def job(self, job_id: str) -> JobSnapshot:
        """Raises NotThere for an unknown one."""
        return self._shown(self._find(job_id).snapshot)

    def lines(self, job_id: str) -> list[str]:
        """The log of a job, oldest first."""
        job = self._find(job_id)
        kept, newest = self._archive.lines(job_id), list(job.lines)
        # What could not be written is still in memory.
        return kept if len(kept) >= len(newest) else newest

    def pause(self, job_id: str) -> JobSnapshot:
        """A running job stops at its next checkpoint, with the lasers off, until it is resumed."""
        return self._set_running(job_id, is_running=False, of=JobState.RUNNING, to=JobState.PAUSED)

    def resume(self, job_id: str) -> JobSnapshot:
        return self._set_running(job_id, is_running=True, of=JobState.PAUSED, to=JobState.RUNNING)

    def ask_person(self, words: str) -> None:
        """Have the job in whose thread this is called wait until a person has done this, and said so.

        Raises:
            DeviceRefused: it is no thread of a job.
            JobCancelled: the job was cancelled instead.
        """
        with self._lock:
            here = threading.current_thread()
            job = next((each for each in self._jobs.values() if each.thread is here), None)
        if job is None:
            hint = "Start a scan: it says when to turn the table, and how far."
            raise DeviceRefused("turntable", f"is worked by hand ({words.rstrip('.')})", hint)
        with self._lock:
            job.has_done.clear()
            self.waits(job, words, asks=True)
        try:
            while not (job.has_done.wait(_LOOKS_UP_S) or job.is_cancelled):
                pass
        finally:
            self.waits(job, "")
        if job.is_cancelled:
            raise JobCancelled

    def is_done_by_hand(self, job_id: str, words: str) -> JobSnapshot:
        """A person says that it is done; a second press meant for the same is none for the next.

        Raises:
            NotNow: the job does not ask for this, or not any more.
        """
        with self._lock:
            job = self._find(job_id)
            if not job.snapshot.asks or job.snapshot.waits_for != words:
                raise NotNow(f"The job {job.snapshot.title!r} does not ask for this.")
            job.has_done.set()
        return self._shown(job.snapshot)

    def cancel(self, job_id: str) -> JobSnapshot:
        """End a job; what it has made so far stays. One that has ended already stays as it is."""
        with self._lock:
            job = self._find(job_id)
            if job.snapshot.state.has_ended:
                return self._shown(job.snapshot)
            job.is_cancelled = True
            job.may_run.set()
            is_waiting = job in self._waiting
            if is_waiting:
                self._waiting.remove(job)
            callbacks = tuple(job.on_cancel)
        if is_waiting:
            job.on_dropped()
            self._end(job, JobState.CANCELLED)
            return self._shown(job.snapshot)
        for callback in callbacks:
            if job.has_ended:
                # The bench may be that of the next job by now.
                break
            try:
                callback()
            except ScannerError as error:
                # The job ends nevertheless, at its next checkpoint.
                _log.warning("while job %s was cancelled: %s", job_id, error.message)
        return job.snapshot

    def forget(self, job_id: str) -> JobSnapshot:
        """Take a job that has ended off the list and off the disk; what it made stays.

        Raises:
            JobRuns: it has not ended.
        """
        with self._lock:
            job = self._find(job_id)
            if not job.snapshot.state.has_ended:
                raise JobRuns(f"The job {job.snapshot.title!r} has not ended.")
            self._drop(job)
        return job.snapshot

    def cancel_on_bench(self) -> None:
        """End the jobs that use the bench, as `cancel` does; those that wait for it stay."""
        with self._lock:
            busy = [job for job in self._jobs.values() if job.needs_bench and job.thread is not None]
        for job in busy:
            self.cancel(job.snapshot.id)

    def close(self, timeout_s: float = 20.0) -> None:
        """End what runs, which is no wish of anybody's, and wait for it."""
        with self._lock:
            self._is_closed = True
            jobs = list(self._jobs.values())
        for job in jobs:
            self.cancel(job.snapshot.id)
        ends = time.monotonic() + timeout_s
        for job in jobs:
            if job.thread is not None:
                job.thread.join(max(0.0, ends - time.monotonic()))

    def _bring_back(self) -> None:
        for snapshot in self._archive.load():
            ended = snapshot.state.has_ended
            if not ended:
                snapshot = replace(
                    snapshot, state=JobState.FAILED, problem=JobProblem.interrupted(), waits_for="",
                    asks=False, seconds_left=None, ended=datetime.now(UTC),
                )  # fmt: skip
                self._archive.save(snapshot)
            self._jobs[snapshot.id] = _Job(snapshot, _over, needs_bench=False, has_ended=True)
        self._prune()

    def _new_id(self, now: datetime) -> str:
        while True:
            name = f"{now:%Y%m%dT%H%M%S}-{uuid4().hex[:6]}"
            if name not in self._jobs:
                return name

    def _find(self, job_id: str) -> "_Job":
        with self._lock:
            job = self._jobs.get(job_id)
        if job is None:
            raise NotThere(f"There is no job {job_id!r}.", "Ask for the list of jobs.")
        return job

    def _shown(self, snapshot: JobSnapshot) -> JobSnapshot:
        """With what only the library knows."""
        is_broken_off = snapshot.state in (JobState.FAILED, JobState.CANCELLED)
        if snapshot.kind != "scan" or not snapshot.scan or not is_broken_off:
            return snapshot
        return replace(snapshot, can_resume=self._is_unfinished(snapshot.scan))

    def _set_running(self, job_id: str, *, is_running: bool, of: JobState, to: JobState) -> JobSnapshot:
        with self._lock:
            job = self._find(job_id)
            has_changed = job.snapshot.state is of
            if has_changed:
                (job.may_run.set if is_running else job.may_run.clear)()
                self._changed(job, state=to)
        if has_changed:
            self._save(job)
        return job.snapshot

    def _start_what_can(self) -> None:
        """In order; a computation may overtake a job that waits for the bench."""
        for job in tuple(self._waiting):
            busy = [each for each in self._jobs.values() if each.thread is not None and not each.has_ended]
            same = [each for each in busy if each.needs_bench == job.needs_bench]
            if len(same) >= (1 if job.needs_bench else self._computations):
                what = "the bench" if job.needs_bench else "the computation"
                words = f"{what}, which {same[0].snapshot.title!r} has"
                if job.snapshot.waits_for != words:
                    self._changed(job, waits_for=words)
                continue
            self._waiting.remove(job)
            job.thread = threading.Thread(target=self._run, args=(job,), name=f"job {job.snapshot.kind}")
            job.thread.daemon = True
            job.began_s = time.monotonic()
            self._changed(job, state=JobState.RUNNING, waits_for="", seconds_left=job.expected_s)
            job.thread.start()

    def _run(self, job: "_Job") -> None:
        self._save(job)
        try:
            result = job.work(JobContext(self, job))
        except JobCancelled:
            self._end(job, JobState.CANCELLED)
        except ScannerError as error:
            if job.is_cancelled:
                # A stop that a cancellation caused is no failure.
                self._end(job, JobState.CANCELLED)
                return
            self.say(job, error.message)
            self._end(job, JobState.FAILED, JobProblem.of(error))
        except Exception as error:  # noqa: BLE001 (edge of a thread: the job ends as failed, with its traceback)
            _log.exception("job %s failed", job.snapshot.id)
            self.say(job, traceback.format_exc())
            self._end(job, JobState.FAILED, JobProblem.of(error))
        else:
            with self._lock:
                self._changed(job, result=dict(result))
            self._end(job, JobState.DONE)

    def _end(self, job: "_Job", state: JobState, problem: JobProblem | None = None) -> None:
        if state is JobState.CANCELLED and self._is_closed:
            state, problem = JobState.FAILED, JobProblem.interrupted()
        with self._lock:
            job.has_ended = True
            job.wait(is_waiting=False)
            self._changed(
                job, state=state, problem=problem, ended=datetime.now(UTC), waits_for="", asks=False,
                seconds=round(job.active_s(), 3), seconds_left=None,
            )  # fmt: skip
            # Whoever sees that it has ended finds it so on the disk.
            self._save(job)
            self._prune()
            self._start_what_can()

    def _save(self, job: "_Job", *, is_durable: bool = True) -> None:
        """The newest state, whichever thread comes last."""
        with self._saving:
            if job.snapshot.id in self._jobs:
                job.saved_s = time.monotonic()
                self._archive.save(job.snapshot, is_durable=is_durable)

    def _prune(self) -> None:
        ended = [job for job in self._jobs.values() if job.has_ended]
        for job in ended[: max(0, len(ended) - _ENDED_KEPT)]:
            self._drop(job)

    def _drop(self, job: "_Job") -> None:
        del self._jobs[job.snapshot.id]
        self._archive.forget(job.snapshot.id)

    def _changed(self, job: "_Job", **changes: Any) -> None:
        job.snapshot = replace(job.snapshot, **changes)
        self.bus.publish(JobChanged(self._shown(job.snapshot)))

    def progress(self, job: "_Job", done: int, total: int, note: str) -> None:
        with self._lock:
            active_s = job.active_s()
            left_s = job.pace.left_s(active_s, done, total)
            self._changed(
                job, done=done, total=total, note=note, seconds=round(active_s, 3), seconds_left=left_s
            )
        if time.monotonic() - job.saved_s > _SAVED_EVERY_S:
            self._save(job, is_durable=False)

    def waits(self, job: "_Job", for_what: str, *, asks: bool = False) -> None:
        with self._lock:
            job.wait(bool(for_what))
            self._changed(job, waits_for=for_what, asks=asks)

    def say(self, job: "_Job", line: str) -> None:
        stamped = f"{datetime.now(UTC):%H:%M:%S} {line}"
        job.lines.append(stamped)
        self._archive.say(job.snapshot.id, stamped)
        self.bus.publish(JobSaid(job.snapshot.id, line))


@dataclass(eq=False, slots=True)
class _Job:
    """A job as it lives; its times are those of the monotonic clock."""

    snapshot: JobSnapshot
    work: Work
    needs_bench: bool
    pace: Pace = field(default_factory=Pace)
    expected_s: float | None = None
    on_dropped: Callable[[], None] = lambda: None
    lines: deque[str] = field(default_factory=lambda: deque(maxlen=_LINES_KEPT))
    on_cancel: list[Callable[[], None]] = field(default_factory=list)
    may_run: threading.Event = field(default_factory=threading.Event)
    has_done: threading.Event = field(default_factory=threading.Event)
    is_cancelled: bool = False
    has_ended: bool = False
    thread: threading.Thread | None = None
    began_s: float = 0.0
    idle_s: float = 0.0
    idle_since_s: float | None = None
    saved_s: float = 0.0

    def __post_init__(self) -> None:
        self.may_run.set()

    def active_s(self) -> float:
        """How long it has worked."""
        if self.thread is None:
            return self.snapshot.seconds
        now = time.monotonic() if self.idle_since_s is None else self.idle_since_s
        return now - self.began_s - self.idle_s

    def wait(self, is_waiting: bool) -> None:
        """From now on it rests or waits, or works again."""
        now = time.monotonic()
        if self.idle_since_s is not None:
            self.idle_s += now - self.idle_since_s
        self.idle_since_s = now if is_waiting else None


def _over(job: "JobContext") -> Mapping[str, Any]:
    """The work of a job of an earlier run, which is never done again."""
    raise JobCancelled


class JobContext:
    """What a job's work has of its runner; used in the thread of the job."""

    def __init__(self, runner: JobRunner, job: _Job) -> None:
        self._runner, self._job = runner, job

    @property
    def id(self) -> str:
        return self._job.snapshot.id

    @property
    def bus(self) -> EventBus:
        return self._runner.bus

    @property
    def is_to_rest(self) -> bool:
        """Whether the job is paused or cancelled, and its work should come to a checkpoint."""
        return self._job.is_cancelled or not self._job.may_run.is_set()

    @property
    def active_s(self) -> float:
        """How long it has worked, without rests and waits."""
        return self._job.active_s()

    def checkpoint(self) -> None:
        """Somewhere the work can rest: waits while the job is paused.

        Raises:
            JobCancelled: the job was cancelled.
        """
        if not self._job.may_run.is_set():
            was_waiting = self._job.idle_since_s is not None
            self._job.wait(is_waiting=True)
            self._job.may_run.wait()
            self._job.wait(was_waiting)
        if self._job.is_cancelled:
            raise JobCancelled

    def progress(self, done: int, total: int, note: str = "") -> None:
        """How much is done, of how much (0 while nobody knows)."""
        self._runner.progress(self._job, done, total, note)

    def waits(self, for_what: str) -> None:
        """What the work waits for; empty when it goes on."""
        self._runner.waits(self._job, for_what)

    def say(self, line: str) -> None:
        """A line for the job's log."""
        self._runner.say(self._job, line)

    def on_cancel(self, callback: Callable[[], None]) -> None:
        """Called in the thread of whoever cancels, such as to stop a table that moves."""
        self._job.on_cancel.append(callback)
