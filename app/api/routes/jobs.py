"""Jobs: started, watched, paused, cancelled."""

from collections.abc import Mapping
from datetime import datetime
from typing import Annotated, Any, Literal

from fastapi import APIRouter
from pydantic import BaseModel, Field, TypeAdapter

from app.api.services import Served, Services
from app.errors import CalibrationFileError, NotThere, OptionError
from app.jobs.job import JobSnapshot, JobState
from app.jobs.recipes import ScanOrder, checkup_work, reconstruct_work, scan_work
from app.jobs.runner import JobContext
from app.scanning.plan import ScanPlan

router = APIRouter(prefix="/jobs", tags=["jobs"])
Title = Annotated[str, Field(min_length=1, max_length=200)]
Name = Annotated[str, Field(min_length=1, max_length=200)]


class ProblemOut(BaseModel):
    """Why a job failed."""

    code: str
    message: str
    hint: str


class JobOut(BaseModel):
    """A job; see `JobSnapshot`."""

    id: str
    kind: str
    title: str
    state: JobState
    created: datetime
    ended: datetime | None
    done: int
    total: int
    note: str
    seconds_left: float | None
    waits_for: str
    problem: ProblemOut | None
    result: dict[str, Any]


class ScanIn(BaseModel):
    """A scan that is wanted.

    Attributes:
        title: what people call it.
        lasers: that scan; all where none is named.
        mode: stop for every picture, or turn steadily.
        steps: stops in one turn.
        turn_deg: how far the table turns.
        seconds_per_turn: of a steady turn.
        with_dark: pictures with the lasers off, too.
    """

    title: Title = "Scan"
    lasers: Annotated[list[str], Field(max_length=64)] = []
    mode: Literal["step", "continuous"] = "step"
    steps: Annotated[int, Field(ge=1, le=10_000)] = 200
    turn_deg: Annotated[float, Field(gt=0.0, le=3600.0)] = 360.0
    seconds_per_turn: Annotated[float, Field(ge=1.0, le=3600.0)] = 30.0
    with_dark: bool = True


class ResumeIn(BaseModel):
    """A scan to go on with, by its name in the library.

    Attributes:
        accept_position: take it that an interrupted move was completed, where nothing shows it.
    """

    scan: Name
    accept_position: bool = False


class ReconstructIn(BaseModel):
    """A scan to compute again with the calibration in use."""

    scan: Name


class CheckupIn(BaseModel):
    """Which checks to make; all where none is named."""

    only: Annotated[list[str], Field(max_length=20)] = []


@router.get("")
def list_jobs(served: Served) -> list[JobOut]:
    """All jobs of this run of the server, newest first."""
    return [shown(job) for job in served.runner.jobs()]


@router.post("/scan")
def start_scan(served: Served, wanted: ScanIn) -> JobOut:
    """Scan what stands on the table."""
    lasers = tuple(wanted.lasers or served.bench.lasers)
    for name in lasers:
        if name not in served.bench.lasers:
            known = ", ".join(served.bench.lasers) or "none"
            raise OptionError(f"The bench has no laser called {name!r}.", f"It has: {known}.")
    if not lasers:
        raise OptionError("The bench has no laser.", "List its lasers in the bench file.")
    plan = ScanPlan.model_validate(wanted.model_dump(exclude={"title"}) | {"lasers": lasers})
    folder = served.library.reserve(wanted.title)
    order = ScanOrder(folder, plan, served.bench_spec)
    return _submitted_scan(served, wanted.title, order)


@router.post("/resume-scan")
def resume_scan(served: Served, wanted: ResumeIn) -> JobOut:
    """Go on with a scan that ended early."""
    item = served.library.scan(wanted.scan)
    order = ScanOrder(item.folder, None, served.bench_spec, takes_target=wanted.accept_position)
    return _submitted_scan(served, item.title, order)


@router.post("/reconstruct")
def start_reconstruction(served: Served, wanted: ReconstructIn) -> JobOut:
    """Compute another cloud of a scan; those it has stay."""
    item, record = served.library.scan(wanted.scan), served.calibration()
    if record is None:
        raise CalibrationFileError("calibration_store", "holds no calibration yet")
    work = reconstruct_work(served.library, item.name, record)
    return shown(served.runner.submit("reconstruct", item.title, work, needs_bench=False))


@router.post("/checkup")
def start_checkup(served: Served, wanted: CheckupIn) -> JobOut:
    """The doctor: measure what the bench really does."""
    work = checkup_work(served.bench, wanted.only, served.library.folder, served.calibration())
    return shown(served.runner.submit("checkup", "Checkup", work, needs_bench=True))


@router.get("/{job_id}")
def show_job(served: Served, job_id: str) -> JobOut:
    """One job."""
    return shown(_found(served, job_id))


@router.get("/{job_id}/log")
def show_log(served: Served, job_id: str) -> list[str]:
    """Its log, oldest line first."""
    return served.runner.lines(_found(served, job_id).id)


@router.post("/{job_id}/pause")
def pause_job(served: Served, job_id: str) -> JobOut:
    """Let it rest, with the lasers off."""
    return shown(served.runner.pause(_found(served, job_id).id))


@router.post("/{job_id}/resume")
def resume_job(served: Served, job_id: str) -> JobOut:
    """Let it go on."""
    return shown(served.runner.resume(_found(served, job_id).id))


@router.post("/{job_id}/cancel")
def cancel_job(served: Served, job_id: str) -> JobOut:
    """End it; what it has made so far stays."""
    return shown(served.runner.cancel(_found(served, job_id).id))


def shown(job: JobSnapshot) -> JobOut:
    """A snapshot as it goes out."""
    return TypeAdapter(JobOut).validate_python(job, from_attributes=True)


def _found(served: Services, job_id: str) -> JobSnapshot:
    for job in served.runner.jobs():
        if job.id == job_id:
            return job
    raise NotThere(f"There is no job {job_id!r}.")


def _submitted_scan(served: Services, title: str, order: ScanOrder) -> JobOut:
    def begin() -> None:
        served.on_scan()
        if order.plan is not None:
            served.library.rename(order.folder.name, title)

    scan = scan_work(served.bench, order, served.calibration(), served.on_profile, begin)

    def work(job: JobContext) -> Mapping[str, Any]:
        try:
            return scan(job)
        finally:
            served.on_scan_end()

    return shown(served.runner.submit("scan", title, work, needs_bench=True))
