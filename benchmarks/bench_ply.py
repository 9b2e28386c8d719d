"""How fast a cloud becomes a PLY file, against bare writing of the same bytes, and in what memory."""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from app.geometry.cloud import PointCloud
from app.surface.ply import VERTEX, PlyWriter
from benchmarks.peak_memory import own_peak_mb, peak_mb_of
from benchmarks.report import Row, at_least, at_most

_POINTS = 5_000_000
_AT_ONCE = 100_000
_ROUNDS = 9


def run() -> list[Row]:
    cloud = _cloud(_AT_ONCE)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "cloud.ply"
        # Taken in turns, so that both see the same disk; the best of each is the one least disturbed.
        written, bare = zip(*((_write(path, cloud), _write_bare(path)) for _ in range(_ROUNDS)), strict=True)
        rate, floor = _POINTS / min(written) / 1e6, _POINTS / min(bare) / 1e6
        peak_mb = peak_mb_of("benchmarks.bench_ply", str(path))
    return [
        at_least("binary PLY", rate, "million points/s", 20.0, f"{_POINTS:,} points of 40 bytes"),
        Row("bare tofile of the same bytes", floor, "million points/s"),
        Row("PLY against bare writing", floor / rate, "times the time"),
        at_most("peak memory of a process that writes 5 million points", peak_mb, "MB", 140.0),
    ]


def _cloud(count: int) -> PointCloud:
    rng = np.random.default_rng(0)

    def floats(*shape: int) -> np.ndarray:
        return rng.random(shape, dtype=np.float32)

    return PointCloud(
        floats(count, 3), floats(count, 3), rng.integers(0, 256, (count, 3), dtype=np.uint8), floats(count),
        np.zeros(count, np.uint8), floats(count), floats(count), ("left", "right"),
    )  # fmt: skip


def _write(path: Path, cloud: PointCloud) -> float:
    start = time.perf_counter()
    with PlyWriter(path, cloud.laser_names) as writer:
        for _ in range(_POINTS // len(cloud)):
            writer.append(cloud)
    return time.perf_counter() - start


def _write_bare(path: Path) -> float:
    rows = np.zeros(_AT_ONCE, VERTEX)
    start = time.perf_counter()
    with path.open("wb") as file:
        for _ in range(_POINTS // _AT_ONCE):
            rows.tofile(file)
    return time.perf_counter() - start


if __name__ == "__main__":
    _write(Path(sys.argv[1]), _cloud(_AT_ONCE))
    print(own_peak_mb())
