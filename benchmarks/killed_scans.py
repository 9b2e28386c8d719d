"""Scans through the server, whose program is killed in their midst, and what becomes of them."""

import json
import random
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from app.calibration.record import CalibrationRecord
from app.recording.reader import Recording
from app.recording.shot import Role
from app.scanning.sources import reconstruct_recording, scan_detector
from app.surface.ply_reader import read_ply
from benchmarks.bench_text import simulated_bench

_RADIUS_MM = 30.0
_ABOVE_MM = 3.0
_PATIENCE_S = 300.0
_HTTP_S = 60.0


class KilledServer:
    """`turnscan serve` in a process of its own, which ends by no good word.

    Args:
        folder: its library, and its bench file.
        size: of the simulated camera's pictures; small ones cost less time.
        rate: of the simulated world.
    """

    def __init__(self, folder: Path, size: tuple[int, int] = (640, 480), rate: float = 20.0) -> None:
        self.scans = folder / "scans"
        self._folder, self._bench = folder, folder / "bench.toml"
        folder.mkdir(parents=True, exist_ok=True)
        width, height = size
        self._bench.write_text(
            simulated_bench(
                {"dialect": "horus", "object": "sphere", "width": width, "height": height, "rate": rate},
                marker_mm=20.0,
            )
        )
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self._port = int(free.getsockname()[1])
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Begin, and wait until its bench is there."""
        command = [sys.executable, "-m", "app", "serve", "--bench", str(self._bench)]
        with (self._folder / "server.log").open("ab") as log:
            self._process = subprocess.Popen(
                [*command, "--folder", str(self._folder), "--port", str(self._port)],
                stdout=log, stderr=subprocess.STDOUT,
            )  # fmt: skip
        wait_for(self._is_ready)

    def kill(self) -> None:
        """As a loss of power would."""
        if self._process is not None:
            self._process.send_signal(signal.SIGKILL)
            self._process.wait()
            self._process = None

    def ask(self, method: str, path: str, body: object = None) -> Any:
        """The answer to a request to the API."""
        request = urllib.request.Request(
            f"http://127.0.0.1:{self._port}/api/v1{path}", method=method,
            data=None if body is None else json.dumps(body).encode(),
            headers={"content-type": "application/json"},
        )  # fmt: skip
        with urllib.request.urlopen(request, timeout=_HTTP_S) as answer:
            return json.load(answer)

    def ended(self, job_id: str) -> Any:
        """The job, once it has ended."""
        wait_for(lambda: self.ask("GET", f"/jobs/{job_id}")["ended"] is not None)
        return self.ask("GET", f"/jobs/{job_id}")

    def _is_ready(self) -> bool:
        with suppress(OSError):
            bench = self.ask("GET", "/bench")
            if bench["camera"]["connected"] and bench["turntable"]:
                return True
            if bench["problems"]:
                # A simulated board that did not answer in time on a busy machine is asked once more.
                self.ask("POST", "/bench/connect")
        return False


@dataclass(frozen=True, slots=True)
class Outcome:
    """What has become of a scan.

    Attributes:
        kills: how often its program was killed.
        not_resumed: how often it could not be gone on with; told by the job.
        shots: pictures of its recording.
        repeated: pictures that it has twice.
        in_vain: pictures on the disk that do not belong to it: those that were in flight.
        off_deg: largest distance of the angles from the planned ones.
        seen_off_deg: the same as the markers on the table show it.
        points: of the cloud.
        rms_mm: distance of its points from a ball of the true radius, placed as they lie.
    """

    kills: int
    not_resumed: tuple[str, ...]
    shots: int
    repeated: int
    in_vain: int
    off_deg: float
    seen_off_deg: float
    points: int
    rms_mm: float


def scan_with_kills(
    server: KilledServer, title: str, steps: int, kills: int, chance: random.Random
) -> Outcome:
    """One scan of a ball, whose program is killed so often, each time at some moment.

    Args:
        server: started; it is again afterwards.
        title: of the scan, and its name in the library.
        steps: stops.
        kills: how often.
        chance: chooses the moments.
    """
    job = server.ask("POST", "/jobs/scan", {"title": title, "steps": steps})
    folder, shots = server.scans / job["scan"], 3 * steps
    not_resumed: list[str] = []
    for number in range(kills):
        taken, began_s = _pictures(folder), time.monotonic()
        wanted = taken + chance.randrange(max(1, (shots - 2 - taken) // (kills - number)))
        wait_for(partial(_has, folder, wanted))
        per_shot_s = (time.monotonic() - began_s) / max(1, _pictures(folder) - taken)
        time.sleep(chance.uniform(0.0, 3.0 * min(per_shot_s, 0.3)))
        server.kill()
        server.start()
        broken = server.ask("GET", f"/jobs/{job['id']}")
        # Killed so late that all its pictures were there, it lacks its cloud alone.
        can_go_on = broken["can_resume"] or len(Recording.open(folder).entries) == shots
        if broken["state"] != "failed" or not can_go_on:
            not_resumed.append(f"{broken['state']}: {broken['problem']}")
        job = server.ask("POST", f"/jobs/{job['id']}/retry", {})
        wait_for(partial(_goes_on, server, job["id"], folder, _pictures(folder)))
    ended = server.ended(job["id"])
    if ended["state"] != "done":
        not_resumed.append(str(ended["problem"]))
    return _outcome(folder, steps, kills, tuple(not_resumed))


def wait_for(is_so: Callable[[], bool], patience_s: float = _PATIENCE_S) -> None:
    """Raises TimeoutError."""
    ends = time.monotonic() + patience_s
    while not is_so():
        if time.monotonic() > ends:
            raise TimeoutError("it never came to be")
        time.sleep(0.005)


def _goes_on(server: KilledServer, job_id: str, folder: Path, taken: int) -> bool:
    return _pictures(folder) > taken or server.ask("GET", f"/jobs/{job_id}")["ended"] is not None


def _has(folder: Path, pictures: int) -> bool:
    return _pictures(folder) >= pictures and (folder / "scan.json").is_file()


def _pictures(folder: Path) -> int:
    frames = folder / "frames"
    return sum(path.suffix in (".png", ".jpg") for path in frames.iterdir()) if frames.is_dir() else 0


def _outcome(folder: Path, steps: int, kills: int, not_resumed: tuple[str, ...]) -> Outcome:
    recording = Recording.open(folder)
    taken = Counter((entry.unknown["stop"], entry.unknown["look"]) for entry in recording.entries)
    planned = [360.0 * int(entry.unknown["stop"]) / steps for entry in recording.entries]
    angles = [entry.angle_deg or 0.0 for entry in recording.select(Role.SCAN, Role.TEXTURE)]
    record = CalibrationRecord.load(folder / "calibration.json")
    run = reconstruct_recording(recording, record.rig, scan_detector())
    for _ in run:
        pass
    points, rms_mm = _ball(folder)
    return Outcome(
        kills, not_resumed, len(recording.entries), sum(taken.values()) - len(taken),
        _pictures(folder) - len(recording.entries),
        float(np.max(np.abs(np.subtract(angles, planned)))), run.report().angles.largest_deg,
        points, rms_mm,
    )  # fmt: skip


def _ball(folder: Path) -> tuple[int, float]:
    """How many points the newest cloud has, and how far those above the table are from the true ball, RMS."""
    clouds = [*(folder / "clouds").glob("*.ply"), *folder.glob("cloud.ply")]
    if not clouds:
        return 0, float("inf")
    points = read_ply(clouds[0]).points.astype(np.float64)
    ball = points[points[:, 2] > _ABOVE_MM]
    terms = np.column_stack([2.0 * ball, np.ones(len(ball))])
    centre = np.linalg.lstsq(terms, np.sum(ball**2, axis=1), rcond=None)[0][:3]
    away = np.linalg.norm(ball - centre, axis=1) - _RADIUS_MM
    return len(points), float(np.sqrt(np.mean(away**2)))
