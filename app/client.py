"""A scanner that somewhere serves its API, driven from Python.

from app.client import Turnscan

with Turnscan("http://localhost:8000") as scanner:
    scanner.calibrate(lambda wish: input(wish["words"]))
    scan = scanner.scan("A mug", steps=200)
    scanner.download(scan, "mug.ply")
"""

import json
import os
import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeAlias
from urllib.parse import quote

import httpx2 as httpx

Job: TypeAlias = Mapping[str, Any]
"""A job as `/api/v1/jobs/{id}` tells it: id, kind, title, state, done, total, result and more."""
Event: TypeAlias = Mapping[str, Any]
"""An event as `/api/v1/events` tells it; its `type` says which."""
Wish: TypeAlias = Mapping[str, Any]
"""What a calibration wants done: `words` for a person, `code` for a program, `problem` if asked once more."""

_ENDED = frozenset({"done", "failed", "cancelled"})
_TRY_AGAIN_S = 0.5
_PIECE = 1 << 20
_PATIENCE_S = 60.0


class ScannerProblem(Exception):  # noqa: N818 (an answer of the scanner, which may be no error of ours)
    """What the scanner could not or would not do.

    Attributes:
        kind: names it for programs, such as `turnscan:bench-busy`; empty where the scanner did not answer.
        hint: what to do.
        status: of the HTTP answer; 0 without one.
    """

    def __init__(self, title: str, hint: str = "", kind: str = "", status: int = 0) -> None:
        super().__init__(title if not hint else f"{title} {hint}")
        self.title, self.hint, self.kind, self.status = title, hint, kind, status


class Turnscan:
    """One scanner; every method raises ScannerProblem where the scanner refuses or does not answer.

    Args:
        address: of the server, such as `https://turnscan.local:8000`.
        token: an API token, where the server has a password; by default `TURNSCAN_TOKEN` of the environment.
        certificates: a file with the certificate to trust, for one that the server signed itself.
        patience_s: how long a server may be away, as while it is started again, before that is a problem.
    """

    def __init__(
        self,
        address: str = "http://localhost:8000",
        token: str | None = None,
        certificates: Path | None = None,
        patience_s: float = _PATIENCE_S,
    ) -> None:
        token = os.environ.get("TURNSCAN_TOKEN") if token is None else token
        self._patience_s = patience_s
        self._http = httpx.Client(
            base_url=f"{address.rstrip('/')}/api/v1/",
            headers={"Authorization": f"Bearer {token}"} if token else {},
            verify=True if certificates is None else str(certificates),
            timeout=httpx.Timeout(60.0, connect=5.0),
        )

    def bench(self) -> Mapping[str, Any]:
        """How the bench stands."""
        return dict(self.ask("GET", "bench"))

    def stop(self) -> None:
        """Emergency stop: lasers off, table stopped."""
        self.ask("POST", "bench/stop")

    def scans(self) -> list[Mapping[str, Any]]:
        """Everything in the library, newest first."""
        return list(self.ask("GET", "scans"))

    def scan(self, title: str, follow: Callable[[Job], None] | None = None, **options: Any) -> str:
        """Scan what stands on the table, and return the scan's name in the library.

        Args:
            title: what people call it.
            follow: told how it goes.
            options: as `POST /jobs/scan` takes them, such as `mode="continuous"` or `lasers=["left"]`.
        """
        job = self.run("jobs/scan", {"title": title, **options}, follow)
        return Path(str(job["result"]["folder"])).name

    def calibrate(
        self, answer: Callable[[Wish], object], follow: Callable[[Job], None] | None = None, **options: Any
    ) -> Mapping[str, Any]:
        """Calibrate, automatically unless `kind` says otherwise, and return what was found.

        Args:
            answer: told each time what has to be done; the calibration goes on when it returns.
            follow: told how it goes.
            options: as `POST /calibrate` takes them.
        """
        job: Job = self.ask("POST", "calibrate", options)
        path = f"calibrate/{quote(str(job['id']), safe='')}"

        def followed(now: Job) -> None:
            if follow is not None:
                follow(now)
            state = self.ask("GET", path) if now["waits_for"] else {}
            if state.get("waits_for_person"):
                answer(state["instruction"])
                self.ask("POST", f"{path}/continue")

        return dict(self._finish(job, followed)["result"])

    def reconstruct(self, scan: str, follow: Callable[[Job], None] | None = None, **options: Any) -> str:
        """Compute another cloud of a scan; return the name of its file."""
        return str(self.run("jobs/reconstruct", {"scan": scan, **options}, follow)["result"]["cloud"])

    def download_calibration(self, to: str | Path, name: str = "current") -> Path:
        """Fetch a calibration that is kept; the one in use where none is named."""
        return self._fetch(f"calibrations/{quote(name, safe='')}/calibration.json", to)

    def export(self, scan: str, to: str | Path, form: str = "ply", cloud: str = "") -> Path:
        """Fetch a cloud in another form, such as `xyz`; the newest where none is named."""
        job = self.run("jobs/export", {"scan": scan, "form": form, "cloud": cloud})
        return self._fetch(f"jobs/{quote(str(job['id']), safe='')}/file", to)

    def download(self, scan: str, to: str | Path, what: str = "cloud.ply") -> Path:
        """Fetch the newest cloud, `recording.zip` or `clouds/NAME` into a file that is whole or not there."""
        return self._fetch(f"scans/{quote(scan, safe='')}/{quote(what)}", to)

    def upload(self, file: str | Path, title: str = "") -> str:
        """Put a recording's zip file or a PLY file into the library; return its name there."""
        source = Path(file)
        with source.open("rb") as content:
            try:
                answer = self._http.post(
                    "scans/upload",
                    params={"title": title, "file": source.name},
                    content=iter(partial(content.read, _PIECE), b""),
                    headers={
                        "Content-Type": "application/octet-stream",
                        "Content-Length": str(source.stat().st_size),
                    },
                    # All of a large scan is checked before it is answered.
                    timeout=httpx.Timeout(60.0, connect=5.0, read=600.0),
                )
            except httpx.HTTPError as error:
                raise _silence(error) from error
        if answer.is_error:
            raise _problem(answer)
        return str(answer.json()["name"])

    def run(self, path: str, order: Mapping[str, Any], follow: Callable[[Job], None] | None = None) -> Job:
        """Order a job and wait for its end."""
        return self._finish(self.ask("POST", path, order), follow)

    def follow(self, job_id: str) -> Iterator[Job]:
        """A job each time something about it changed, until it has ended."""
        job: Job = self.ask("GET", f"jobs/{quote(job_id, safe='')}")
        yield job
        if job["state"] in _ENDED:
            return
        for event in self.events():
            told: list[Job] = event["jobs"] if event["type"] == "state" else [event.get("job", {})]
            for job in told:
                if job.get("id") == job_id:
                    yield job
                    if job["state"] in _ENDED:
                        return

    def events(self) -> Iterator[Event]:
        """What happens, as it happens: `state` first, and again when the server was away for a moment."""
        ends_s = time.monotonic() + self._patience_s
        while True:
            try:
                with self._http.stream("GET", "events/stream") as answer:
                    if answer.is_error:
                        answer.read()
                        raise _problem(answer)
                    for line in answer.iter_lines():
                        ends_s = time.monotonic() + self._patience_s
                        if line.startswith("data:"):
                            yield json.loads(line.removeprefix("data:"))
            except httpx.TransportError as error:
                if time.monotonic() > ends_s:
                    raise _silence(error) from error
            time.sleep(_TRY_AGAIN_S)

    def ask(self, method: str, path: str, body: Mapping[str, Any] | None = None) -> Any:
        """One request below `/api/v1/`; what is answered, from JSON."""
        ends_s = time.monotonic() + self._patience_s
        while True:
            try:
                answer = self._http.request(method, path, json=body)
                break
            except httpx.TransportError as error:
                # Nothing was done where no connection was made; what only looks may look again.
                may_repeat = method == "GET" or isinstance(error, httpx.ConnectError)
                if not may_repeat or time.monotonic() > ends_s:
                    raise _silence(error) from error
                time.sleep(_TRY_AGAIN_S)
        if answer.is_error:
            raise _problem(answer)
        return json.loads(answer.content) if answer.content else None

    def _finish(self, job: Job, follow: Callable[[Job], None] | None) -> Job:
        for snapshot in self.follow(str(job["id"])):
            job = snapshot
            if follow is not None:
                follow(job)
        if job["state"] != "done":
            problem = job.get("problem") or {}
            title = problem.get("message") or f"The job was {job['state']}."
            code = problem.get("code", job["state"])
            raise ScannerProblem(title, problem.get("hint", ""), f"turnscan:{code}")
        return job

    def _fetch(self, path: str, to: str | Path) -> Path:
        target = Path(to)
        beside = target.with_name(f".{target.name}.part")
        try:
            with self._http.stream("GET", path) as answer, beside.open("wb") as file:
                if answer.is_error:
                    answer.read()
                    raise _problem(answer)
                for part in answer.iter_bytes():
                    file.write(part)
            beside.replace(target)
        except httpx.HTTPError as error:
            raise _silence(error) from error
        finally:
            beside.unlink(missing_ok=True)
        return target

    def close(self) -> None:
        self._http.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _problem(answer: httpx.Response) -> ScannerProblem:
    try:
        told = json.loads(answer.content)
        return ScannerProblem(told["title"], told.get("hint", ""), told.get("type", ""), answer.status_code)
    except (ValueError, KeyError, TypeError):
        return ScannerProblem(f"The server answered {answer.status_code}.", status=answer.status_code)


def _silence(error: httpx.HTTPError) -> ScannerProblem:
    return ScannerProblem(f"The server does not answer: {error}.", "Is it running, and is the address right?")
