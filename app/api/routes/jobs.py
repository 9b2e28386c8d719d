"""Jobs: watched, paused, cancelled, taken off the list. What starts them is in `job_orders`."""

from datetime import datetime
from typing import Annotated, Any

from fastapi import APIRouter
from fastapi.responses import FileResponse
from pydantic import BaseModel, Field, TypeAdapter

from app.api.services import Served
from app.jobs.export import exported
from app.jobs.job import JobSnapshot, JobState

router = APIRouter(prefix="/jobs", tags=["jobs"])
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
    seconds: float
    seconds_left: float | None
    waits_for: str
    asks: bool
    problem: ProblemOut | None
    result: dict[str, Any]
    scan: str
    can_resume: bool


class DoneIn(BaseModel):
    """What a person has done.

    Attributes:
        words: as the job asked for it, its `waits_for`.
    """

    words: Annotated[str, Field(max_length=1000)]


@router.get("")
def list_jobs(served: Served) -> list[JobOut]:
    """The jobs of this run of the server and of earlier ones, newest first."""
    return [shown(job) for job in served.runner.jobs()]


@router.get("/{job_id}")
def show_job(served: Served, job_id: str) -> JobOut:
    """One job."""
    return shown(served.runner.job(job_id))


@router.get("/{job_id}/log")
def show_log(served: Served, job_id: str) -> list[str]:
    """Its log, oldest line first."""
    return served.runner.lines(job_id)


@router.get("/{job_id}/file", response_class=FileResponse)
def download_file(served: Served, job_id: str) -> FileResponse:
    """What an export job wrote."""
    job = served.runner.job(job_id)
    path = exported(served.library, job.scan, job.result.get("file"))
    name = f"{job.scan}-{path.name}"
    return FileResponse(path, media_type="application/octet-stream", filename=name)


@router.post("/{job_id}/pause")
def pause_job(served: Served, job_id: str) -> JobOut:
    """Let it rest, with the lasers off."""
    return shown(served.runner.pause(job_id))


@router.post("/{job_id}/resume")
def resume_job(served: Served, job_id: str) -> JobOut:
    """Let it go on."""
    return shown(served.runner.resume(job_id))


@router.post("/{job_id}/done")
def tell_done(served: Served, job_id: str, done: DoneIn) -> JobOut:
    """What the job asked a person for, such as to turn a table without a motor, is done."""
    return shown(served.runner.is_done_by_hand(job_id, done.words))


@router.post("/{job_id}/cancel")
def cancel_job(served: Served, job_id: str) -> JobOut:
    """End it; what it has made so far stays."""
    return shown(served.runner.cancel(job_id))


@router.delete("/{job_id}")
def delete_job(served: Served, job_id: str) -> JobOut:
    """Take a job that has ended off the list; what it made stays."""
    return shown(served.runner.forget(job_id))


def shown(job: JobSnapshot) -> JobOut:
    """A snapshot as it goes out."""
    return TypeAdapter(JobOut).validate_python(job, from_attributes=True)
