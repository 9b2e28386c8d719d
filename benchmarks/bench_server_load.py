"""The whole server under load: a continuous scan at 720p30 while people look at pictures and at the cloud.

The server and its simulated bench run in this process, which has another one render the pictures, as
`turnscan serve` does; those who look run in a third.
"""

import asyncio
import contextlib
import gc
import math
import multiprocessing
import os
import socket
import statistics
import tempfile
import threading
import time
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import psutil
import uvicorn
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed
from websockets.typing import Subprotocol

from app.api.services import Services
from app.api.versioned import API
from app.devices.bench_file import simulated_description
from app.devices.camera import Camera
from app.jobs.recipes import ScanOrder, scan_work
from app.main import create_app
from app.scanning.live import LivePoints
from app.scanning.plan import ScanPlan
from app.scanning.profile import Profile
from app.scanning.scan import Taken
from app.settings import Settings
from app.viewer.live_cloud import LiveCloud
from app.viewer.page import viewer_page
from app.viewer.proxy import SOCKET_OPTIONS
from benchmarks.bench_live_pictures import ReadyCamera, ready_pictures
from benchmarks.report import Row, at_most

_TURN_S, _SHORT_TURN_S = 15.0, 4.0
_QUIET_S, _WARM_S = 10.0, 2.0
_SCANS = 10
_SETTLED_SCANS = 3
_OVERLAYS, _CLOUDS = 4, 2
# A message of the view that carries points, not only the angle of the table.
_LEAST_BYTES = 1500


@dataclass(eq=False)
class _Watch:
    """What happened in one scan; times are monotonic."""

    exposed_s: dict[int, float] = field(default_factory=dict)
    pushes: list[tuple[float, list[int]]] = field(default_factory=list)
    pictures: int = 0
    cpu: list[tuple[float, float]] = field(default_factory=list)

    def taken(self, taken: Taken) -> None:
        self.pictures += 1
        if taken.look.lasers:
            self.exposed_s[_at(math.radians(taken.angle_deg))] = taken.frame.exposed_s
        self.cpu.append((time.monotonic(), time.process_time()))

    def pushed(self, profiles: Sequence[Profile]) -> None:
        self.pushes.append((time.monotonic(), [_at(each.angle_rad) for each in profiles]))

    @property
    def used(self) -> float:
        """Share of one processor from the first to the last picture."""
        (begin_s, before), (end_s, after) = self.cpu[0], self.cpu[-1]
        return (after - before) / (end_s - begin_s)

    def latencies_s(self, arrivals: Sequence[float]) -> list[float]:
        """From each picture's exposure to the message that carries its points, for one viewer."""
        found = []
        for at_s, numbers in self.pushes:
            where = bisect_left(arrivals, at_s)
            if where < len(arrivals):
                found += [arrivals[where] - self.exposed_s[n] for n in numbers if n in self.exposed_s]
        return found


def run() -> list[Row]:
    load = os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as folder, _served(Path(folder)) as (services, port):
        rows = _streams(services, port)
        _scan(services, Path(folder) / "warm", _SHORT_TURN_S)
        alone = _scan(services, Path(folder) / "alone", _TURN_S)
        lost = _lost(services)
        with _looking(port) as people:
            watched = _scan(services, Path(folder) / "watched", _TURN_S)
            frames_lost = _lost(services) - lost
            sizes = [_memory(services, Path(folder) / f"scan{number}") for number in range(_SCANS)]
        fps = services.live.state
    latencies = [latency for arrivals in people.arrivals for latency in watched.latencies_s(arrivals)]
    taken = watched.pictures
    note = f"load of the machine at the start {load:.1f}"
    late = statistics.quantiles(latencies, n=20)[-1]
    pictures = [count / people.seconds for count in people.pictures]
    return [
        *rows,
        Row("pictures of the scan while watched", taken, "pictures", note=f"{alone.pictures} alone"),
        at_most("frames lost while watched", frames_lost, "frames", 0.0, note),
        at_most("frame to 3D view, median", 1e3 * statistics.median(latencies), "ms", 200.0,
                f"{len(latencies)} pictures and viewers; 95 % within {1e3 * late:.0f} ms"),
        at_most("the streams' share", 100.0 * (watched.used - alone.used), "% of one core", 40.0,
                f"server {100.0 * watched.used:.0f} % watched, {100.0 * alone.used:.0f} % alone"),
        Row("pictures per second of an overlay viewer", statistics.mean(pictures), "1/s",
            note=f"{fps.skipped} frames left out since the last viewer came" if fps.skipped else ""),
        at_most(f"memory over {_SCANS} scans, from the {_SETTLED_SCANS}rd on",
                sizes[-1] - sizes[_SETTLED_SCANS - 1], "MB", 30.0,
                f"{sizes[_SETTLED_SCANS - 1]:.0f} to {sizes[-1]:.0f} MB"),
    ]  # fmt: skip


def _at(angle_rad: float) -> int:
    """A picture's place in its turn, as its profile has it, too: thousandths of a degree."""
    return round(1e3 * math.degrees(angle_rad)) % 360_000


def _streams(services: Services, port: int) -> list[Row]:
    """What the streams take where the camera's files are ready, so that none has to be simulated."""
    files, rig, board = ready_pictures()
    camera = Camera(ReadyCamera(files))
    camera.connect()
    live = services.live
    former, known = live._camera, live.known
    live._camera = live._darkroom._camera = camera
    live.learn(rig=rig, board=board)
    services.bench.switch("left", True)
    try:
        idle = _used(_QUIET_S)
        with _looking(port) as people:
            time.sleep(_WARM_S)
            used = _used(_QUIET_S)
    finally:
        services.bench.switch("left", False)
        live._camera = live._darkroom._camera = former
        live.learn(rig=known.rig, board=known.board)
        camera.disconnect()
    fps = statistics.mean(people.pictures) / people.seconds
    what = "a camera at 720p30 without a scan, the streams' share"
    note = f"{fps:.1f} pictures/s for each of the overlay, load of the machine {os.getloadavg()[0]:.1f}"
    return [at_most(what, 100.0 * (used - idle), "% of one core", 40.0, note)]


def _used(seconds: float) -> float:
    """Share of one processor that this process uses."""
    began_s, cpu_s = time.monotonic(), time.process_time()
    time.sleep(seconds)
    return (time.process_time() - cpu_s) / (time.monotonic() - began_s)


def _scan(services: Services, folder: Path, turn_s: float) -> _Watch:
    """One turn with one laser, as the API would order it."""
    plan = ScanPlan(lasers=("left",), mode="continuous", seconds_per_turn=turn_s)
    watch = _Watch()
    services.on_scan()
    work = scan_work(
        services.bench, ScanOrder(folder, plan, services.bench_spec), services.calibration(),
        services.on_profile,
    )  # fmt: skip
    with _watched(watch):
        job = services.runner.submit("scan", "Load", work, needs_bench=True)
        while not (now := services.runner.job(job.id)).state.has_ended:
            time.sleep(0.1)
    services.on_scan_end()
    if now.problem is not None:
        raise RuntimeError(now.problem.message)
    return watch


def _memory(services: Services, folder: Path) -> float:
    """What the process holds after one more scan, MB."""
    _scan(services, folder, _SHORT_TURN_S)
    gc.collect()
    return float(psutil.Process().memory_info().rss) / 1e6


def _lost(services: Services) -> int:
    return services.bench.camera.state.lost


@contextlib.contextmanager
def _watched(watch: _Watch) -> Iterator[None]:
    """Note what goes by on its way, at the price of a list's append."""
    add, push = LivePoints.add, LiveCloud.push

    def adding(points: LivePoints, taken: Taken) -> None:
        watch.taken(taken)
        add(points, taken)

    def pushing(cloud: LiveCloud, profiles: Sequence[Profile]) -> None:
        watch.pushed(profiles)
        push(cloud, profiles)

    LivePoints.add, LiveCloud.push = adding, pushing  # type: ignore[method-assign, assignment]
    try:
        yield
    finally:
        LivePoints.add, LiveCloud.push = add, push  # type: ignore[method-assign]


@contextlib.contextmanager
def _served(folder: Path) -> Iterator[tuple[Services, int]]:
    application = create_app(Settings(folder, "simulated"), simulated_description())
    with socket.create_server(("127.0.0.1", 0)) as listening:
        server = uvicorn.Server(uvicorn.Config(application, log_level="error", **SOCKET_OPTIONS))
        thread = threading.Thread(target=server.run, args=([listening],), name="web server")
        thread.start()
        services: Services = application.state.services
        while not services.bench.camera.state.frames or not services.bench.turntable.is_connected:
            time.sleep(0.05)
        yield services, listening.getsockname()[1]
        server.should_exit = True
        thread.join()


@dataclass(eq=False)
class _People:
    """What came to those who look."""

    arrivals: list[list[float]] = field(default_factory=list)
    pictures: list[int] = field(default_factory=list)
    seconds: float = 1.0


@contextlib.contextmanager
def _looking(port: int) -> Iterator[_People]:
    """Four look at the overlay, two at the cloud, and one at nothing that is sent to them."""
    people = _People()
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=_look, args=(port, viewer_page().dialect, there))
    process.start()
    here.recv()
    try:
        yield people
    finally:
        here.send("end")
        people.arrivals, people.pictures, people.seconds = here.recv()
        process.join()


def _look(port: int, dialect: str, pipe: Connection) -> None:
    pipe.send(asyncio.run(_all_look(port, dialect, pipe)))


async def _all_look(port: int, dialect: str, pipe: Connection) -> tuple[list[list[float]], list[int], float]:
    arrivals: list[list[float]] = [[] for _ in range(_CLOUDS)]
    counts = [0] * _OVERLAYS
    options: dict[str, Any] = {"max_size": None, "compression": None, "proxy": None, "ping_interval": None}

    async def overlay(number: int) -> None:
        async with connect(f"ws://127.0.0.1:{port}{API}/live/overlay", **options) as viewer:
            while True:
                await viewer.send("next")
                await viewer.recv(decode=False)
                counts[number] += 1

    async def cloud(mine: list[float]) -> None:
        spoken = [Subprotocol(dialect)]
        async with connect(f"ws://127.0.0.1:{port}/view", subprotocols=spoken, **options) as viewer:
            while True:
                message = await viewer.recv()
                if len(message) > _LEAST_BYTES:
                    mine.append(time.monotonic())

    async def never_reads() -> None:
        async with connect(f"ws://127.0.0.1:{port}{API}/live/overlay", max_queue=1, **options) as viewer:
            while True:
                await viewer.send("next")
                await asyncio.sleep(0.05)

    ways = [*(overlay(n) for n in range(_OVERLAYS)), *(cloud(mine) for mine in arrivals), never_reads()]
    tasks = [asyncio.create_task(way) for way in ways]
    began_s = time.monotonic()
    pipe.send("begun")
    await asyncio.to_thread(pipe.recv)
    seconds = time.monotonic() - began_s
    for task in tasks:
        task.cancel()
    for outcome in await asyncio.gather(*tasks, return_exceptions=True):
        if isinstance(outcome, Exception) and not isinstance(outcome, ConnectionClosed):
            raise outcome
    return arrivals, counts, seconds
