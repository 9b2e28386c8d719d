"""How a piece of work stands, as everybody who asks is told."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from enum import StrEnum
from typing import Any

from app.errors import ScannerError


class JobState(StrEnum):
    """Where in its life a job is."""

    QUEUED = "queued"
    RUNNING = "running"
    PAUSED = "paused"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"

    @property
    def has_ended(self) -> bool:
        return self in (JobState.DONE, JobState.FAILED, JobState.CANCELLED)


@dataclass(frozen=True, slots=True)
class JobProblem:
    """Why a job failed.

    Attributes:
        code: of the error, for programs.
        message: one sentence, for people.
        hint: what to do.
    """

    code: str
    message: str
    hint: str = ""

    @classmethod
    def of(cls, error: BaseException) -> "JobProblem":
        """An error that was expected speaks for itself; of a surprise the type is told."""
        if isinstance(error, ScannerError):
            return cls(error.code, error.message, error.hint)
        return cls("surprise", f"{type(error).__name__}: {error}", "Please report this with the job's log.")

    @classmethod
    def interrupted(cls) -> "JobProblem":
        """The program ended, however, while the job had not."""
        return cls(
            "interrupted",
            "The program ended before this job did.",
            "A scan can be gone on with; start anything else again.",
        )


@dataclass(frozen=True, slots=True)
class JobSnapshot:
    """A job at one moment.

    Attributes:
        id: names it.
        kind: what it does: scan, texture, checkup, reconstruct, export.
        title: the same for people.
        state: where in its life it is.
        done, total: how much of it is done, of how much; total 0 while nobody knows.
        note: what it is at.
        seconds: how long it has worked, without rests and waits; by a clock that nobody sets.
        seconds_left: as far as can be foretold; None where it cannot.
        waits_for: what it waits for, such as its turn or a device that is away; empty for nothing.
        asks: whether that is something a person is to do, and to say so with `JobRunner.is_done_by_hand`.
        problem: why it failed.
        result: what it made, by name.
        created, ended: when, in UTC.
        scan: name in the library of the scan that it works on; empty for none.
        can_resume: whether that scan is unfinished, and nobody is at it.
        order: what was asked for, so that it can be asked for again; None where that cannot be.
        number: counts the jobs in the order they were taken.
    """

    id: str
    kind: str
    title: str
    state: JobState
    created: datetime
    done: int = 0
    total: int = 0
    note: str = ""
    seconds: float = 0.0
    seconds_left: float | None = None
    waits_for: str = ""
    problem: JobProblem | None = None
    result: Mapping[str, Any] = field(default_factory=dict)
    ended: datetime | None = None
    scan: str = ""
    can_resume: bool = False
    order: Mapping[str, Any] | None = None
    number: int = 0
    asks: bool = False


class JobCancelled(Exception):  # noqa: N818 (an event, not an error)
    """Somebody cancelled the job; raised in its own thread, at its next checkpoint."""
