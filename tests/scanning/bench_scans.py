"""Scans on a small, fast simulated bench."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from app.devices.bench import Bench
from app.devices.bench_file import BenchDescription, simulated_description
from app.devices.cameras.simulated import SimulatedCamera
from app.recording.manifest import FrameEntry
from app.scanning.plan import ScanPlan
from app.scanning.scan import Taken
from app.scanning.session import ScanSession
from app.simulation.world import SimulatedWorld
from app.vision.markers import PlatterSpec

PLATTER = {"kind": "aruco", "dictionary": "DICT_4X4_50", "marker_mm": 14.0, "ids": [0, 1, 2, 3, 4, 5]}
PLATTER_SPEC = PlatterSpec("DICT_4X4_50", 14.0, (0, 1, 2, 3, 4, 5))


def description(
    dialect: str = "horus", *, has_platter: bool = False, **simulation: object
) -> BenchDescription:
    """A bench of 320 x 240 pixels, twenty times as fast as a real one."""
    options: dict[str, object] = {"width": 320, "height": 240, "rate": 20.0, "object": "sphere"}
    plain = simulated_description(dialect, **(options | simulation))
    if not has_platter:
        return plain
    return BenchDescription.model_validate(plain.model_dump() | {"platter": PLATTER}, strict=False)


@contextmanager
def bench_with(described: BenchDescription) -> Iterator[Bench]:
    """It, connected."""
    with Bench.build(described) as bench:
        bench.connect()
        yield bench


def plan(steps: int = 12, **changed: object) -> ScanPlan:
    return ScanPlan.model_validate({"lasers": ("left", "right"), "steps": steps} | changed)


def begin(folder: Path, bench: Bench, scan: ScanPlan) -> ScanSession:
    return ScanSession.create(folder, scan, bench, "simulated")


def world_of(bench: Bench) -> SimulatedWorld:
    assert bench.world is not None
    return bench.world


def camera_of(bench: Bench) -> SimulatedCamera:
    assert isinstance(bench.camera.driver, SimulatedCamera)
    return bench.camera.driver


def true_angle_deg(bench: Bench) -> float:
    """Where the table truly stands now."""
    world = world_of(bench)
    return world.plant.at(world.clock.now_s()).angle_deg


def is_dark(bench: Bench) -> bool:
    world = world_of(bench)
    return not world.plant.at(world.clock.now_s()).outputs_on


class Watching:
    """Notes what happens, and does something after the n-th picture."""

    def __init__(self, at: int = -1, do: Callable[[], None] | None = None) -> None:
        self.entries: list[FrameEntry] = []
        self.pictures: list[Taken] = []
        self.problems: list[str] = []
        self.resumed = 0
        self._at, self._do = at, do

    def after(self, count: int, do: Callable[[], None]) -> None:
        """Do something after so many pictures."""
        self._at, self._do = count, do

    def taken(self, taken: Taken, entry: FrameEntry) -> None:
        self.entries.append(entry)
        self.pictures.append(taken)
        if len(self.entries) == self._at and self._do is not None:
            self._do()

    def waiting(self, problem: str) -> None:
        self.problems.append(problem)

    def going_on(self) -> None:
        self.resumed += 1


class Truth(Watching):
    """Compares every picture's angle with where the table truly was."""

    def __init__(self, bench: Bench) -> None:
        super().__init__()
        self.bench, self.errors_deg = bench, list[float]()

    def taken(self, taken: Taken, entry: FrameEntry) -> None:
        super().taken(taken, entry)
        world = world_of(self.bench)
        true = world.plant.at(world.clock.world_s(taken.time_s)).angle_deg
        self.errors_deg.append(abs(true - taken.angle_deg))


def later(delay_s: float, do: Callable[[], None]) -> threading.Timer:
    """Do something after a while, in a thread of its own."""
    timer = threading.Timer(delay_s, do)
    timer.daemon = True
    timer.start()
    return timer


def wait_until(is_so: Callable[[], bool], timeout_s: float = 60.0) -> None:
    ends = time.monotonic() + timeout_s
    while not is_so():
        assert time.monotonic() < ends, "it never came to be"
        time.sleep(0.002)
