"""Events as they go out: one JSON object each, whose `type` says which it is."""

import itertools
from collections import OrderedDict
from typing import Annotated, Literal, TypeAlias

from pydantic import BaseModel, Field, RootModel

from app.api.bench_out import BenchOut, shown_bench
from app.api.routes.jobs import JobOut, shown
from app.devices.bench import Bench
from app.jobs.calibrate_state import CalibrationState
from app.jobs.events import (
    BenchChanged,
    CalibrationChanged,
    Counters,
    Event,
    JobChanged,
    JobSaid,
    PointsAdded,
)
from app.jobs.job import JobSnapshot

_KEPT = 64


class CountersOut(BaseModel):
    """What is counted; see `Counters`."""

    type: Literal["counters"] = "counters"
    frames: int
    lost: int
    fps: float
    points: int
    viewers: dict[str, int]
    live_fps: dict[str, float]
    skipped: int
    bytes_sent: int


class StateOut(BaseModel):
    """How everything stands: the first event of each connection, in place of whatever was known before."""

    type: Literal["state"] = "state"
    bench: BenchOut
    jobs: list[JobOut]
    counters: CountersOut


class JobChangedOut(BaseModel):
    """A job is new, or at another point than before."""

    type: Literal["job-changed"] = "job-changed"
    job: JobOut


class JobSaidOut(BaseModel):
    """A job has a line for its log."""

    type: Literal["job-said"] = "job-said"
    job_id: str
    line: str


class PointsAddedOut(BaseModel):
    """A scan has more points: so many in all."""

    type: Literal["points-added"] = "points-added"
    job_id: str
    points: int


class BenchChangedOut(BaseModel):
    """Something about the bench is different."""

    type: Literal["bench-changed"] = "bench-changed"
    bench: BenchOut


class CalibrationChangedOut(BaseModel):
    """A calibration that is being made stands differently."""

    type: Literal["calibration-changed"] = "calibration-changed"
    calibration: CalibrationState


class NoticeOut(BaseModel):
    """Something to be told to people, whatever they are doing."""

    type: Literal["notice"] = "notice"
    text: str
    hint: str


EventOut: TypeAlias = (
    CalibrationChangedOut
    | StateOut
    | JobChangedOut
    | JobSaidOut
    | PointsAddedOut
    | BenchChangedOut
    | NoticeOut
    | CountersOut
)


class AnyEventOut(RootModel[Annotated[EventOut, Field(discriminator="type")]]):
    """One event."""


class Wire:
    """Puts each event into words once, however many listen. For one thread.

    Args:
        bench: whose state goes with its events.
    """

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._numbers = itertools.count(1)
        self._kept: OrderedDict[int, tuple[Event, int, str]] = OrderedDict()

    def state(self, jobs: list[JobSnapshot], counters: Counters) -> tuple[int, str]:
        """Number and text of the first event of a connection."""
        told = StateOut(
            bench=shown_bench(self._bench), jobs=[shown(job) for job in jobs], counters=_counted(counters)
        )
        return next(self._numbers), told.model_dump_json()

    def event(self, event: Event) -> tuple[int, str]:
        """Number and text of an event; later ones have higher numbers."""
        kept = self._kept.get(id(event))
        if kept is None or kept[0] is not event:
            kept = event, next(self._numbers), self._told(event).model_dump_json()
            self._kept[id(event)] = kept
            if len(self._kept) > _KEPT:
                self._kept.popitem(last=False)
        return kept[1:]

    def _told(self, event: Event) -> EventOut:
        if isinstance(event, JobChanged):
            return JobChangedOut(job=shown(event.job))
        if isinstance(event, JobSaid):
            return JobSaidOut(job_id=event.job_id, line=event.line)
        if isinstance(event, PointsAdded):
            return PointsAddedOut(job_id=event.job_id, points=event.points)
        if isinstance(event, CalibrationChanged):
            return CalibrationChangedOut(calibration=event.calibration)
        if isinstance(event, Counters):
            return _counted(event)
        if isinstance(event, BenchChanged):
            return BenchChangedOut(bench=shown_bench(self._bench))
        return NoticeOut(text=event.text, hint=event.hint)


def _counted(counters: Counters) -> CountersOut:
    return CountersOut.model_validate(counters, from_attributes=True)
