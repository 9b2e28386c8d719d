"""Runs jobs in threads: one at a time on the bench, some computations beside it."""

import json
import logging
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypeAlias
from uuid import uuid4

from app.errors import OptionError, ScannerError
from app.files import make_folder, write_whole
from app.jobs.events import EventBus, JobChanged, JobSaid
from app.jobs.job import JobCancelled, JobProblem, JobSnapshot, JobState

_LINES_KEPT = 500
_COMPUTATIONS = 1
_log = logging.getLogger(__name__)

Work: TypeAlias = "Callable[[JobContext], Mapping[str, Any]]"
"""Does the job and returns what it made, by name, ready for JSON."""


class JobRunner:
    """Takes jobs, runs each in a thread of its own when its turn has come, and keeps how they ended.

    Args:
        folder: ended jobs are kept here, one JSON file each.
        bus: told every change.
    """

    def __init__(self, folder: Path, bus: EventBus) -> None:
        self.bus = bus
        self._folder = folder
        make_folder(folder)
        self._lock = threading.RLock()
        self._jobs: dict[str, _Job] = {}
        self._waiting: deque[_Job] = deque()
        self._is_closed = False

    def submit(self, kind: str, title: str, work: Work, *, needs_bench: bool) -> JobSnapshot:
        """Take a job; it begins at once, or when those before it have ended."""
        now = datetime.now(UTC)
        snapshot = JobSnapshot(f"{now:%Y%m%dT%H%M%S}-{uuid4().hex[:6]}", kind, title, JobState.QUEUED, now)
        job = _Job(snapshot, work, needs_bench)
        with self._lock:
            if self._is_closed:
                raise OptionError("The server is closing.", "Start it again.")
            self._jobs[snapshot.id] = job
            self._waiting.append(job)
            self._changed(job)
            self._start_what_can()
        return job.snapshot

    def jobs(self) -> list[JobSnapshot]:
        """All of this run, newest first."""
        with self._lock:
            return [job.snapshot for job in reversed(self._jobs.values())]

    def job(self, job_id: str) -> JobSnapshot:
        """Raises OptionError for an unknown one."""
        return self._find(job_id).snapshot

    def lines(self, job_id: str) -> list[str]:
        """The log of a job, oldest first."""
        return list(self._find(job_id).lines)

    def pause(self, job_id: str) -> JobSnapshot:
        """A running job stops at its next checkpoint, with the lasers off, until it is resumed."""
        return self._set_running(job_id, is_running=False, of=JobState.RUNNING, to=JobState.PAUSED)

    def resume(self, job_id: str) -> JobSnapshot:
        return self._set_running(job_id, is_running=True, of=JobState.PAUSED, to=JobState.RUNNING)

    def cancel(self, job_id: str) -> JobSnapshot:
        """End a job; what it has made so far stays. One that has ended already stays as it is."""
        with self._lock:
            job = self._find(job_id)
            if job.snapshot.state.has_ended:
                return job.snapshot
            job.is_cancelled = True
            job.may_run.set()
            if job in self._waiting:
                self._waiting.remove(job)
                self._end(job, JobState.CANCELLED)
                return job.snapshot
            callbacks = tuple(job.on_cancel)
        for callback in callbacks:
            callback()
        return job.snapshot

    def cancel_on_bench(self) -> None:
        """End the jobs that use the bench, as `cancel` does; those that wait for it stay."""
        with self._lock:
            busy = [job for job in self._jobs.values() if job.needs_bench and job.thread is not None]
        for job in busy:
            self.cancel(job.snapshot.id)

    def close(self, timeout_s: float = 20.0) -> None:
        """Cancel what runs and wait for it to end."""
        with self._lock:
            self._is_closed = True
            jobs = list(self._jobs.values())
        for job in jobs:
            self.cancel(job.snapshot.id)
        ends = time.monotonic() + timeout_s
        for job in jobs:
            if job.thread is not None:
                job.thread.join(max(0.0, ends - time.monotonic()))

    def _find(self, job_id: str) -> "_Job":
        with self._lock:
            job = self._jobs.get(job_id)
        if job is None:
            raise OptionError(f"There is no job {job_id!r}.", "Ask for the list of jobs.")
        return job

    def _set_running(self, job_id: str, *, is_running: bool, of: JobState, to: JobState) -> JobSnapshot:
        with self._lock:
            job = self._find(job_id)
            if job.snapshot.state is of:
                (job.may_run.set if is_running else job.may_run.clear)()
                self._changed(job, state=to)
            return job.snapshot

    def _start_what_can(self) -> None:
        """In order; a computation may overtake a job that waits for the bench."""
        for job in tuple(self._waiting):
            busy = [each for each in self._jobs.values() if each.thread is not None and not each.has_ended]
            same = [each for each in busy if each.needs_bench == job.needs_bench]
            if len(same) >= (1 if job.needs_bench else _COMPUTATIONS):
                continue
            self._waiting.remove(job)
            job.thread = threading.Thread(target=self._run, args=(job,), name=f"job {job.snapshot.kind}")
            job.thread.daemon = True
            job.began_s = time.monotonic()
            self._changed(job, state=JobState.RUNNING)
            job.thread.start()

    def _run(self, job: "_Job") -> None:
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
                self._changed(job, result=dict(result), seconds_left=0.0)
            self._end(job, JobState.DONE)

    def _end(self, job: "_Job", state: JobState, problem: JobProblem | None = None) -> None:
        with self._lock:
            job.has_ended = True
            self._changed(
                job, state=state, problem=problem, ended=datetime.now(UTC), waits_for="", seconds_left=None
            )
            self._keep(job)
            self._start_what_can()

    def _keep(self, job: "_Job") -> None:
        """How it ended, and its log, for later; a full disk must not take the job down with it."""
        document = asdict(job.snapshot) | {"log": list(job.lines)}
        try:
            text = json.dumps(document, indent=1, default=str)
            write_whole(self._folder / f"{job.snapshot.id}.json", text.encode(), is_durable=False)
        except ScannerError as error:
            _log.warning("the end of job %s cannot be kept: %s", job.snapshot.id, error)

    def _changed(self, job: "_Job", **changes: Any) -> None:
        job.snapshot = replace(job.snapshot, **changes)
        self.bus.publish(JobChanged(job.snapshot))

    def progress(self, job: "_Job", done: int, total: int, note: str) -> None:
        with self._lock:
            left = None
            if 0 < done < total:
                running_s = time.monotonic() - job.began_s - job.rested_s
                left = running_s * (total - done) / done
            self._changed(job, done=done, total=total, note=note, seconds_left=left)

    def waits(self, job: "_Job", for_what: str) -> None:
        with self._lock:
            self._changed(job, waits_for=for_what)

    def say(self, job: "_Job", line: str) -> None:
        job.lines.append(f"{datetime.now(UTC):%H:%M:%S} {line}")
        self.bus.publish(JobSaid(job.snapshot.id, line))


@dataclass(eq=False, slots=True)
class _Job:
    snapshot: JobSnapshot
    work: Work
    needs_bench: bool
    lines: deque[str] = field(default_factory=lambda: deque(maxlen=_LINES_KEPT))
    on_cancel: list[Callable[[], None]] = field(default_factory=list)
    may_run: threading.Event = field(default_factory=threading.Event)
    is_cancelled: bool = False
    has_ended: bool = False
    thread: threading.Thread | None = None
    began_s: float = 0.0
    rested_s: float = 0.0

    def __post_init__(self) -> None:
        self.may_run.set()


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

    def checkpoint(self) -> None:
        """Somewhere the work can rest: waits while the job is paused.

        Raises:
            JobCancelled: the job was cancelled.
        """
        if not self._job.may_run.is_set():
            began_s = time.monotonic()
            self._job.may_run.wait()
            self._job.rested_s += time.monotonic() - began_s
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
