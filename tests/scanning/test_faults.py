"""Whatever happens to the devices, a scan ends finished or paused, with nothing lost and nothing left on."""

import contextlib
import random
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from bench_scans import (
    PLATTER_SPEC,
    Truth,
    begin,
    bench_with,
    camera_of,
    description,
    is_dark,
    plan,
    world_of,
)

from app.devices.bench import Bench
from app.errors import DeviceError
from app.recording.reader import Recording
from app.scanning.find_angle import MarkerFinder
from app.scanning.run import Recovery, run_scan
from app.scanning.session import ScanSession

SCANS, FAULTS_EACH = 3, 10
_STEPS = 40
_RATE = 10.0
_LONGEST_S = 300.0
# A second, and what a busy machine adds.
_DARK_WITHIN_S = 2.0
_ANGLE_DEG = 0.2


@dataclass
class Trouble:
    """Makes faults, one after the other, while a scan runs.

    Attributes:
        bench: that is troubled.
        happened: monotonic time and name of every fault.
    """

    bench: Bench
    seed: int
    happened: list[tuple[float, str]] = field(default_factory=list)
    is_over: threading.Event = field(default_factory=threading.Event)

    def run(self) -> None:
        chance = random.Random(self.seed)
        world, camera = world_of(self.bench), camera_of(self.bench)
        while len(self.happened) < FAULTS_EACH and not self.is_over.wait(chance.uniform(0.02, 0.2)):
            name = chance.choice(("unplug", "garbage", "freeze", "reset", "slow", "silence", "camera gone"))
            self.happened.append((time.monotonic(), name))
            pause_s = chance.uniform(0.02, 0.4)
            if name == "unplug":
                world.port.unplug()
                self.is_over.wait(pause_s)
                world.port.plug_in()
            elif name == "camera gone":
                camera.unplug()
                self.is_over.wait(pause_s)
                camera.plug_in()
            elif name == "freeze":
                camera.freeze()
            elif name == "garbage":
                world.port.garbage(chance.randrange(1, 200))
            elif name == "reset":
                world.port.reset()
            elif name == "slow":
                world.port.slow(chance.uniform(0.1, 5.0))
            else:
                world.port.silence(chance.uniform(0.1, 5.0))


@pytest.mark.parametrize("seed", range(SCANS))
def test_random_faults_lose_nothing(tmp_path: Path, seed: int) -> None:
    described = description(has_platter=True, width=400, height=300, rate=_RATE, seed=seed)
    with bench_with(described) as bench:
        session = begin(tmp_path / "scan", bench, plan(_STEPS, lasers=("left",)))
        truth, trouble = Truth(bench), Trouble(bench, seed)
        recovery = Recovery(60.0, MarkerFinder(world_of(bench).rig, PLATTER_SPEC, session.folder))
        faults = threading.Thread(target=trouble.run, daemon=True)
        scan = threading.Thread(target=_scan, args=(bench, session, truth, recovery), daemon=True)
        faults.start()
        scan.start()
        scan.join(_LONGEST_S)
        is_hanging = scan.is_alive()
        trouble.is_over.set()
        faults.join()
        assert not is_hanging, f"the scan hangs after {trouble.happened}"
        assert len(trouble.happened) == FAULTS_EACH
        assert session.status in ("finished", "paused")
        assert is_dark(bench)
        _check_darkness(bench, trouble)
        assert max(truth.errors_deg, default=0.0) < _ANGLE_DEG
    kept = Recording.open(session.folder)
    assert len(kept.entries) == len(truth.entries) == session.shots
    for entry in kept.entries:
        kept.load(entry)
    if session.status == "finished":
        assert session.shots == 2 * _STEPS


def _scan(bench: Bench, session: ScanSession, truth: Truth, recovery: Recovery) -> None:
    with contextlib.suppress(DeviceError):
        run_scan(bench, session, truth, recovery)


def _check_darkness(bench: Bench, trouble: Trouble) -> None:
    """After every fault there is a moment within a second at which no laser is lit."""
    world = world_of(bench)
    for happened_s, name in trouble.happened:
        since, until = world.clock.world_s(happened_s), world.clock.world_s(happened_s + _DARK_WITHIN_S)
        lit: set[int] = set()
        was_dark = False
        for event in world.plant.events:
            if event.time_s > until:
                break
            if event.time_s > since and not lit:
                was_dark = True
            if event.what == "laser on":
                lit.add(event.output)
            elif event.what == "laser off":
                lit.discard(event.output)
            if event.time_s > since and not lit:
                was_dark = True
        assert was_dark or not lit, f"a laser stayed on after {name}"
