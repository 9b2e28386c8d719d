"""How long a stripe takes from pixels to points, as ratios to what cannot be avoided."""

import itertools
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np

from app.geometry.axis import TurntableAxis
from app.geometry.camera import CameraIntrinsics
from app.geometry.plane import LaserPlane
from app.geometry.rig import Rig, Triangulator
from app.scanning.sources import scan_detector
from app.vision.kernels import kernels, twin
from app.vision.stripe import STRIPE_DETECTORS, Image, LaserView
from benchmarks.report import Row, at_least, at_most
from benchmarks.stripe_scenes import Scene

_SCENE = Scene("1080p", contrast=0.1, lines=1080, width=1920)
_THREADS = 2
_PAIRS = 12
# Real frames come from memory: together these are larger than the caches of most processors.
_ROTATED = 6
# The bare zero crossing, for a rig whose stripe and camera are known.
_BARE = {"scoring": False, "measures_noise": False, "sigma_px": 2.0}


def run() -> list[Row]:
    views = [LaserView(*_SCENE.pair(seed), "red") for seed in range(_ROTATED)]
    detectors = {
        "default detector": STRIPE_DETECTORS.make("zero-crossing"),
        "as a scan uses it": scan_detector(),
        "bare zero crossing": STRIPE_DETECTORS.make("zero-crossing", **_BARE),
    }
    tasks = [in_turns(read_once, views)] + [in_turns(each.detect, views) for each in detectors.values()]
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        read_s, *taken_s = least_seconds(*tasks)
        by_twin = STRIPE_DETECTORS.make("zero-crossing", compiled=False)
        (twin_s,) = least_seconds(lambda: by_twin.detect(views[0]), repeats=5)
    finally:
        cv2.setNumThreads(before)
    note = f"reading both frames {1e3 * read_s:.2f} ms; one thread, {_ROTATED} pairs in turns"
    rows = [
        at_most(f"extraction, 1080p BGR pair, {name}", taken / read_s, "x reading", 2.5,
                f"{1e3 * taken:.2f} ms; {note}")
        for name, taken in zip(detectors, taken_s, strict=True)
    ]  # fmt: skip
    rows.append(Row("the same, NumPy twin", twin_s / read_s, "x reading", note=f"{1e3 * twin_s:.2f} ms"))
    triangulator = Triangulator.of(_rig())
    pixels = detectors["default detector"].detect(views[0]).pixels
    (points_s,) = least_seconds(lambda: triangulator.points(pixels, "laser", 0.7), repeats=300)
    rows.append(
        at_most(
            "triangulation with distortion", 1e3 * points_s, "ms", 0.1, f"{len(pixels)} points, one thread"
        )
    )
    rows.append(_from_jpeg(triangulator))
    if kernels() is twin:
        rows.append(Row("numba is missing: all of this is the twin", 0.0, ""))
    return rows


def read_once(view: LaserView) -> float:
    """A pass over all bytes of both pictures that does as little as can be."""
    return sum(float(cv2.norm(frame, cv2.NORM_L1)) for frame in (view.lit, view.dark) if frame is not None)


def in_turns(task: Callable[[LaserView], object], views: list[LaserView]) -> Callable[[], object]:
    """The task on one view after the other, so that none is still in the cache when its turn comes."""
    turns = itertools.cycle(views)
    return lambda: task(next(turns))


def least_seconds(*tasks: Callable[[], object], repeats: int = 60) -> list[float]:
    """Shortest time of each task, taken in turns so that a busy machine is busy for all."""
    least = [np.inf] * len(tasks)
    for task in tasks:
        task()
    for _ in range(repeats):
        for index, task in enumerate(tasks):
            start = time.perf_counter()
            task()
            least[index] = min(least[index], time.perf_counter() - start)
    return least


def _from_jpeg(triangulator: Triangulator) -> Row:
    """Pairs of JPEG frames to points, beside decoding them alone; as many threads for either."""
    files = []
    for seed in range(_PAIRS):
        pair = _SCENE.pair(seed)
        files.append([cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 90])[1] for picture in pair])
    detector = scan_detector()

    def decoded(pair: list[Image]) -> list[Image]:
        return [np.asarray(cv2.imdecode(file, cv2.IMREAD_GRAYSCALE), np.uint8) for file in pair]

    def points(pair: list[Image]) -> int:
        lit, dark = decoded(pair)
        stripe = detector.detect(LaserView(lit, dark, "red"))
        return len(triangulator.points(stripe.pixels, "laser", 0.7))

    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        with ThreadPoolExecutor(_THREADS) as pool:
            decode_s, points_s = least_seconds(
                lambda: list(pool.map(decoded, files)), lambda: list(pool.map(points, files)), repeats=9
            )
    finally:
        cv2.setNumThreads(before)
    note = f"{_PAIRS / points_s:.0f} pairs/s, decoding alone {_PAIRS / decode_s:.0f}; {_THREADS} threads"
    what = "MJPG pair to points, 1080p, decoded as grey, as a scan does it"
    return at_least(what, 100.0 * decode_s / points_s, "% of decoding", 75.0, note)


def _rig() -> Rig:
    camera = CameraIntrinsics(
        np.array([[1400.0, 0.0, 960.0], [0.0, 1400.0, 540.0], [0.0, 0.0, 1.0]]),
        np.array([-0.3, 0.1, 0.001, -0.001, 0.02]),
        (1920, 1080),
    )
    plane = LaserPlane.through(np.array([0.0, 0.0, 300.0]), np.array([0.87, 0.0, 0.5]))
    axis = TurntableAxis(np.array([0.0, 30.0, 300.0]), np.array([0.0, -0.94, -0.34]), 0.0)
    return Rig(camera, {"laser": plane}, axis)
