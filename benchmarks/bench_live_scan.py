"""Scans on the simulated bench in real time: whether pictures are lost, and what of the machine they need."""

import math
import os
import tempfile
import time
from itertools import pairwise
from pathlib import Path

from app.devices.bench import Bench
from app.devices.bench_file import simulated_description
from app.recording.manifest import FrameEntry
from app.scanning.live import LivePoints
from app.scanning.plan import ScanPlan
from app.scanning.run import run_scan
from app.scanning.scan import Taken
from app.scanning.session import ScanSession
from app.scanning.sources import scan_detector
from benchmarks.report import Row, at_most

_SECONDS_PER_TURN = 30.0
_STEPS = 40


def run() -> list[Row]:
    return [*_continuous(), *_steps()]


def _continuous() -> list[Row]:
    """One turn in 30 s at 720p30, one laser: every picture rendered, recorded and computed as it comes."""
    plan = ScanPlan(mode="continuous", lasers=("left",), seconds_per_turn=_SECONDS_PER_TURN, with_dark=False)
    watch, session, lost, used = _scanned(plan)
    times = [taken.time_s for taken in watch.pictures]
    gaps = sum(round((b - a) * 30.0) - 1 for a, b in pairwise(times))
    what = "continuous scan, 720p30, 30 s a turn: "
    return [
        at_most(what + "pictures lost", float(gaps + lost), "pictures", 0.0, f"{session.shots} recorded"),
        at_most(what + "pictures left out of the live points", float(watch.live.left_out), "pictures", 0.0,
                f"{watch.live.points:,} points"),
        Row(what + "processors used", used, "of 2", note="the simulated camera's process left out"),
    ]  # fmt: skip


def _steps() -> list[Row]:
    plan = ScanPlan(lasers=("left", "right"), steps=_STEPS)
    began_s = time.perf_counter()
    watch, session, _, used = _scanned(plan)
    stop_s = (time.perf_counter() - began_s) / _STEPS
    note = f"{session.shots} pictures, {watch.live.points:,} points live, {used:.1f} processors"
    return [
        Row("step scan, 720p, both lasers and a dark picture: a stop of 9 degrees", stop_s, "s", note=note)
    ]


class _Watch:
    def __init__(self, live: LivePoints) -> None:
        self.live, self.pictures = live, list[Taken]()

    def taken(self, taken: Taken, entry: FrameEntry) -> None:
        self.pictures.append(taken)
        self.live.add(taken)

    def waiting(self, problem: str) -> None:
        raise RuntimeError(problem)

    def going_on(self) -> None:
        """Never reached: waiting raises."""


def _scanned(plan: ScanPlan) -> tuple[_Watch, ScanSession, int, float]:
    """What a scan gave: its watch, its session, pictures lost by the camera, processors used."""
    with tempfile.TemporaryDirectory() as folder, Bench.build(simulated_description("horus")) as bench:
        bench.connect()
        assert bench.world is not None
        bench.camera.fresh_frame().image()
        colours = {name: entry.colour for name, entry in bench.lasers.items()}
        session = ScanSession.create(Path(folder) / "scan", plan, bench, "simulated")
        began_s, cpu = time.perf_counter(), os.times()
        with LivePoints(bench.world.rig, scan_detector(), colours, math.radians) as live:
            watch = _Watch(live)
            run_scan(bench, session, watch)
        now = os.times()
        used = (now.user + now.system - cpu.user - cpu.system) / (time.perf_counter() - began_s)
        return watch, session, bench.camera.state.lost, used
