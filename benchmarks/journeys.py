"""From an empty folder to a measured ball through a server's address, by plain requests or by the client."""

import json
import math
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import httpx2 as httpx
import numpy as np
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.sync.connection import Connection

from app.api.versioned import API
from app.calibration.record import CalibrationRecord
from app.client import Turnscan, Wish
from app.geometry.arrays import Points
from app.simulation.stage import Stage
from app.surface.ply_reader import read_ply
from benchmarks.synthetic_views import surface_error_mm

Json: TypeAlias = dict[str, Any]
RADIUS_MM = 30.0
# Nearer to the table than this, a point may belong to it.
_ABOVE_TABLE_MM = 3.0
_PATIENCE_S = 600.0
# What a person would do, on the simulated bench.
_HANDS: Mapping[str, str] = {
    "place-board": "board",
    "place-board-again": "board-again",
    "clear-table": "nothing",
}


@dataclass(frozen=True, slots=True)
class ScannedBall:
    """A scan of the ball of the simulated bench.

    Attributes:
        points: of the cloud, without those next to the table.
        off_mm: their distance from the true ball at its true place in the table's frame, RMS.
        shape_mm: the same from a ball of the true radius, placed as they lie.
        seconds: from its order to its download.
    """

    points: int
    off_mm: float
    shape_mm: float
    seconds: float


@dataclass(frozen=True, slots=True)
class Journey:
    """What came of it.

    Attributes:
        expected_mm: error that the calibration tells of itself.
        true_mm: the one it has, on a cylinder about the axis.
        calibrate_s: how long it took.
        scans: by their modes.
    """

    expected_mm: float
    true_mm: float
    calibrate_s: float
    scans: Mapping[str, ScannedBall]


def by_requests(address: str, folder: Path, truth: Stage, scans: Mapping[str, Mapping[str, Any]]) -> Journey:
    """With nothing but HTTP and the events' WebSocket.

    Args:
        address: of the server, such as `http://localhost:8000`.
        folder: for what is downloaded.
        truth: the scene as it truly is.
        scans: how to scan, by names for them.
    """
    sockets = f"{address.replace('http', 'ws', 1)}{API}/events"
    with (
        httpx.Client(base_url=f"{address}{API}/", timeout=120.0) as http,
        connect(sockets, max_size=None, proxy=None) as socket,
    ):
        events = _Events(socket)
        begun_s = time.monotonic()
        job = _answer(http.post("calibrate", json={"kind": "automatic"}))
        events.follow(job["id"], partial(_help, http, job["id"]))
        calibrate_s = time.monotonic() - begun_s
        kept = folder / "calibration.json"
        kept.write_bytes(_checked(http.get("calibrations/current/calibration.json")).content)
        balls = {}
        for name, wanted in scans.items():
            begun_s = time.monotonic()
            ended = events.follow(_answer(http.post("jobs/scan", json={"title": name, **wanted}))["id"])
            cloud = folder / f"{name}.ply"
            cloud.write_bytes(_checked(http.get(f"scans/{ended['scan']}/cloud.ply")).content)
            balls[name] = _ball(cloud, truth, time.monotonic() - begun_s)
    return _journey(kept, truth, calibrate_s, balls)


def by_client(address: str, folder: Path, truth: Stage, scans: Mapping[str, Mapping[str, Any]]) -> Journey:
    """The same with the Python client."""
    with Turnscan(address) as scanner:

        def answer(wish: Wish) -> None:
            scanner.ask("POST", "bench/simulated/stage", {"stage": _HANDS[wish["code"]]})

        begun_s = time.monotonic()
        scanner.calibrate(answer)
        calibrate_s = time.monotonic() - begun_s
        kept = scanner.download_calibration(folder / "calibration-of-client.json")
        balls = {name: scanned_by_client(scanner, folder, truth, name, scans[name]) for name in scans}
    return _journey(kept, truth, calibrate_s, balls)


def scanned_by_client(
    scanner: Turnscan, folder: Path, truth: Stage, name: str, wanted: Mapping[str, Any]
) -> ScannedBall:
    """One scan with the Python client."""
    begun_s = time.monotonic()
    cloud = scanner.download(scanner.scan(name, **wanted), folder / f"{name}-of-client.ply")
    return _ball(cloud, truth, time.monotonic() - begun_s)


class _Events:
    """What the socket tells, read as it is needed."""

    def __init__(self, socket: Connection) -> None:
        self._socket = socket

    def follow(self, job_id: str, help_out: Callable[[Json], None] = lambda state: None) -> Json:
        """The job once it is done; helps a calibration that waits."""
        ends_s = time.monotonic() + _PATIENCE_S
        helped: Json = {}
        while True:
            event = json.loads(self._socket.recv(timeout=ends_s - time.monotonic()))
            if event["type"] == "calibration-changed" and event["calibration"]["job_id"] == job_id:
                state = event["calibration"]
                if state["waits_for_person"] and state["instruction"] != helped:
                    helped = state["instruction"]
                    help_out(state)
            elif event["type"] == "job-changed" and event["job"]["id"] == job_id and event["job"]["ended"]:
                if event["job"]["state"] != "done":
                    raise RuntimeError(f"the job did not end well: {event['job']}")
                job: Json = event["job"]
                return job


def _help(http: httpx.Client, job_id: str, state: Json) -> None:
    stage = _HANDS[state["instruction"]["code"]]
    _answer(http.post("bench/simulated/stage", json={"stage": stage}))
    _answer(http.post(f"calibrate/{job_id}/continue"))


def _answer(answer: httpx.Response) -> Json:
    told: Json = _checked(answer).json()
    return told


def _checked(answer: httpx.Response) -> httpx.Response:
    if answer.is_error:
        raise RuntimeError(f"{answer.status_code}: {answer.text}")
    return answer


def _journey(kept: Path, truth: Stage, calibrate_s: float, scans: Mapping[str, ScannedBall]) -> Journey:
    record = CalibrationRecord.load(kept)
    return Journey(
        record.expected_error_mm, surface_error_mm(truth.scanner.rig, record.rig), calibrate_s, scans
    )


def _ball(cloud: Path, truth: Stage, seconds: float) -> ScannedBall:
    points = read_ply(cloud).points.astype(np.float64)
    ball = points[points[:, 2] > _ABOVE_TABLE_MM]
    terms = np.column_stack([2.0 * ball, np.ones(len(ball))])
    placed = np.linalg.lstsq(terms, np.sum(ball**2, axis=1), rcond=None)[0][:3]
    return ScannedBall(len(ball), _rms(ball, _true_centre(truth)), _rms(ball, placed), seconds)


def _true_centre(truth: Stage) -> Points:
    return truth.table_from_item @ np.array([0.0, 0.0, RADIUS_MM])


def _rms(ball: Points, centre: Points) -> float:
    return math.sqrt(float(np.mean((np.linalg.norm(ball - centre, axis=1) - RADIUS_MM) ** 2)))


def wait_until_ready(address: str) -> None:
    """Poll until the bench is there. Raises TimeoutError."""
    ends_s = time.monotonic() + _PATIENCE_S
    with httpx.Client(base_url=f"{address}{API}/", timeout=60.0) as http:
        while time.monotonic() < ends_s:
            with suppress(httpx.TransportError, ConnectionClosed):
                bench = http.get("bench").json()
                camera = bench["camera"]
                if camera["connected"] and not camera["frozen"] and bench["turntable"]:
                    return
            time.sleep(0.1)
    raise TimeoutError("the bench never came to be")
