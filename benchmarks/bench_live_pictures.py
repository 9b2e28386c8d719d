"""Live pictures of a 720p camera at 30 fps: what making and handing them out takes of one processor."""

import itertools
import statistics
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial

from app.devices.bench import Bench
from app.devices.bench_file import simulated_description
from app.devices.camera import Camera
from app.devices.camera_driver import CameraFacts, Control, ControlName, RawFrame
from app.devices.frame import Frame, LazyPicture, Mounting
from app.errors import DeviceTimeout
from app.geometry.rig import Rig
from app.live.dark import DarkReference
from app.live.develop import Flavour, develop
from app.live.known import Known
from app.live.pictures import LivePictures
from app.live.search import Found
from app.live.settings import Kind, LiveSettings
from app.live.sight import Sight
from app.vision.board import BoardSpec
from benchmarks.report import Row, at_most

_SECONDS = 8.0
_WARM_S = 1.5
_FPS = 30.0
_SHOTS = 6
_SIZE = (1280, 720)
_TIMES = 40


class ReadyCamera:
    """Sends JPEG files that are there already, so that only the live pictures are measured."""

    def __init__(self, files: Sequence[bytes]) -> None:
        self._files, self._number, self._next_s = files, 0, 0.0

    @property
    def facts(self) -> CameraFacts:
        return CameraFacts("ready", "nowhere", _SIZE, _FPS, has_timestamps=True, gives_jpeg=True)

    def connect(self) -> None:
        self._next_s = time.monotonic()

    def disconnect(self) -> None:
        """Nothing is held."""

    def grab(self, timeout_s: float) -> RawFrame:
        wait_s = self._next_s - time.monotonic()
        if wait_s > timeout_s:
            time.sleep(timeout_s)
            raise DeviceTimeout("ready", "a picture", timeout_s)
        time.sleep(max(0.0, wait_s))
        self._number += 1
        exposed_s, self._next_s = self._next_s, max(self._next_s + 1.0 / _FPS, time.monotonic() - 1.0 / _FPS)
        return RawFrame(self._files[self._number % len(self._files)], exposed_s, 1000.0)

    def controls(self) -> Mapping[ControlName, Control]:
        return {}

    def set_control(self, name: ControlName, value: float | None) -> Control:
        raise NotImplementedError(name)


def run() -> list[Row]:
    files, rig, board = ready_pictures()
    known = Known({"left": "red", "right": "red"}, rig, board=board)
    idle = _used(files, known, {})
    rows = [Row("the camera alone, nobody watching", 100.0 * idle[0], "% of one core")]
    for what, viewers, step, limit in (
        ("1 viewer of the overlay", {Kind.OVERLAY: 1}, 1, None),
        ("4 viewers of the overlay", {Kind.OVERLAY: 4}, 1, 40.0),
        ("4 viewers of the overlay, every other line", {Kind.OVERLAY: 4}, 2, 40.0),
        ("4 viewers of the camera's own picture", {Kind.RAW: 4}, 1, None),
        ("1 viewer of each kind", dict.fromkeys(Kind, 1), 1, None),
    ):
        used, fps, age_ms = _used(files, known, viewers, step)
        share = 100.0 * (used - idle[0])
        note = f"each gets {fps:.1f} pictures/s, {age_ms:.0f} ms old at the median"
        name = f"720p30, one laser: {what}"
        rows.append(
            Row(name, share, "% of one core", note=note)
            if limit is None
            else at_most(name, share, "% of one core", limit, note)
        )
    return rows + _costs(files, known)


def ready_pictures() -> tuple[list[bytes], Rig, BoardSpec]:
    """Files of a real-looking scene with the left laser on."""
    with Bench.build(simulated_description()) as bench:
        bench.connect()
        assert bench.world is not None
        with bench.lit("left"):
            first = bench.camera.fresh_frame()
            with bench.camera.stream() as stream:
                later = list(itertools.islice(stream, _SHOTS - 1))
            files = [frame.encoded("jpeg") for frame in (first, *later)]
        return files, bench.world.rig, bench.world.stage.board


def _used(
    files: Sequence[bytes], known: Known, viewers: Mapping[Kind, int], step: int = 1
) -> tuple[float, float, float]:
    """Share of one processor, pictures per second of the slowest viewer, and their median age in ms."""
    camera = Camera(ReadyCamera(files))
    camera.connect()
    live = LivePictures(camera, known, lit=lambda: ("left",), settings=LiveSettings(line_step=step))
    is_over = threading.Event()
    ages: list[list[float]] = [[] for _ in range(sum(viewers.values()))]

    def look(kind: Kind, mine: list[float]) -> None:
        with live.watch(kind) as viewer:
            while not is_over.is_set():
                picture = viewer.next(0.5)
                if picture is not None:
                    mine.append(time.monotonic() - picture.exposed_s)

    kinds = [kind for kind, count in viewers.items() for _ in range(count)]
    threads = [threading.Thread(target=look, args=each) for each in zip(kinds, ages, strict=True)]
    for thread in threads:
        thread.start()
    try:
        time.sleep(_WARM_S)
        before = [len(mine) for mine in ages]
        began_s, cpu_s = time.perf_counter(), time.process_time()
        time.sleep(_SECONDS)
        took_s = time.perf_counter() - began_s
        used = (time.process_time() - cpu_s) / took_s
        counts = [len(mine) - first for mine, first in zip(ages, before, strict=True)]
    finally:
        is_over.set()
        for thread in threads:
            thread.join()
        live.close()
        camera.disconnect()
    seen = [age for mine in ages for age in mine]
    return used, min(counts, default=0) / took_s, 1e3 * statistics.median(seen) if seen else 0.0


def _costs(files: Sequence[bytes], known: Known) -> list[Row]:
    """Milliseconds of one processor per picture, decoding and all."""
    camera = Camera(ReadyCamera(files))
    camera.connect()
    with camera.stream() as stream:
        frames = list(itertools.islice(stream, _TIMES))
    camera.disconnect()
    rows = []
    for what, flavour in (
        ("raw, passed through", Flavour(Kind.RAW)),
        ("raw, 640 wide", Flavour(Kind.RAW, 640)),
        ("overlay, whole", Flavour(Kind.OVERLAY, 1280)),
        ("overlay, 640 wide", Flavour(Kind.OVERLAY, 640)),
        ("mask as JPEG", Flavour(Kind.MASK)),
        ("mask as bits", Flavour(Kind.MASK, None, True)),
        ("stripe", Flavour(Kind.STRIPE)),
    ):
        rows.append(_cost(what, partial(_one, flavour, known), frames))
    return rows


def _one(flavour: Flavour, known: Known, frame: Frame) -> int:
    sight = Sight(_again(frame), LiveSettings(), known, ("left",), DarkReference())
    return len(develop(flavour, sight, Found(), frame.encoded("jpeg")).data)


def _again(frame: Frame) -> Frame:
    """The frame as if nobody had looked at it."""
    picture = LazyPicture(RawFrame(frame.encoded("jpeg")), frame.size, Mounting(), "ready")
    return Frame(
        frame.index, frame.size, frame.exposed_s, frame.arrived_s, frame.exposure_us, frame.is_timed, picture
    )


def _cost(what: str, make: Callable[[Frame], int], frames: Sequence[Frame]) -> Row:
    make(frames[0])
    times, size = [], 0
    for frame in frames:
        began_s = time.thread_time()
        size = make(frame)
        times.append(1e3 * (time.thread_time() - began_s))
    return Row(f"one picture: {what}", statistics.median(times), "ms of a core", note=f"{size / 1000:.1f} kB")
