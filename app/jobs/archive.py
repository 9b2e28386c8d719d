"""Jobs on disk: a JSON document and a log for each, from which the next run of the program knows them."""

import contextlib
import json
import logging
import re
import threading
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from app.errors import OutputError
from app.files import make_folder, reason, write_whole
from app.jobs.job import JobSnapshot

_NAME = re.compile(r"\d{8}T\d{6}-[0-9a-f]{6}")
_MOST_READ = 400
_MOST_BYTES = 8 << 20
_LOG_BYTES = 4 << 20
_SNAPSHOT = TypeAdapter(JobSnapshot)
_log = logging.getLogger(__name__)


class JobArchive:
    """A folder of jobs. Writing never fails: a full disk must not take a job down with it.

    Args:
        folder: made where it is missing; where that fails, nothing is kept.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._lock = threading.Lock()
        self._problem = ""
        with contextlib.suppress(OutputError):
            make_folder(folder)

    def load(self) -> list[JobSnapshot]:
        """The newest some hundred, in the order they were taken; what is damaged is logged and left out."""
        try:
            names = sorted(path.stem for path in self._folder.glob("*.json") if _NAME.fullmatch(path.stem))
        except OSError as error:
            _log.warning("The earlier jobs in %s cannot be read: %s.", self._folder, reason(error))
            return []
        found = [self._read(name) for name in names[-_MOST_READ:]]
        # The clock may have jumped between two jobs; the number tells which was first.
        return sorted((job for job in found if job is not None), key=lambda job: (job.number, job.id))

    def save(self, job: JobSnapshot, *, is_durable: bool = True) -> None:
        """Put a job as it is now in place of what was known of it."""
        text = json.dumps(asdict(replace(job, can_resume=False)), indent=1, default=str)
        try:
            write_whole(self._path(job.id, "json"), text.encode(), is_durable=is_durable)
        except OutputError as error:
            self._complain(job.id, error.problem)

    def say(self, job_id: str, line: str) -> None:
        """Add a line to its log; a log of some megabytes takes no more."""
        path = self._path(job_id, "log")
        try:
            with self._lock, path.open("ab") as file:
                if file.tell() < _LOG_BYTES:
                    file.write(line.replace("\n", "\n  ").encode("utf-8", "replace") + b"\n")
        except OSError as error:
            self._complain(job_id, reason(error))

    def lines(self, job_id: str) -> list[str]:
        """Its log, oldest first; empty where there is none."""
        try:
            return self._path(job_id, "log").read_bytes().decode("utf-8", "replace").split("\n")[:-1]
        except OSError:
            return []

    def forget(self, job_id: str) -> None:
        """Take a job off the disk."""
        for suffix in ("json", "log"):
            with suppress(OSError):
                self._path(job_id, suffix).unlink(missing_ok=True)

    def _path(self, job_id: str, suffix: str) -> Path:
        return self._folder / f"{job_id}.{suffix}"

    def _read(self, name: str) -> JobSnapshot | None:
        path = self._path(name, "json")
        try:
            if path.stat().st_size > _MOST_BYTES:
                raise ValueError("is too large")
            job = _SNAPSHOT.validate_json(path.read_bytes())
            if job.id != name:
                raise ValueError(f"tells of another job, {job.id[:40]!r}")
        except ValidationError as error:
            problem = f"is damaged ({error.errors()[0]['msg']})"
        except OSError as error:
            problem = reason(error)
        except ValueError as error:
            problem = str(error)
        else:
            return job
        _log.warning("The job in %s is left out: it %s.", path, problem)
        return None

    def _complain(self, job_id: str, problem: str) -> None:
        """Once for each problem in a row: a full disk stays full."""
        if problem != self._problem:
            _log.warning("What becomes of job %s cannot be kept: %s.", job_id, problem)
        self._problem = problem
