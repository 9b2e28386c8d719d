"""Steps and normals on large clouds: time, memory, and what they find, keep and bend."""

import sys
import time
from dataclasses import replace

import numpy as np

from app.geometry.cloud import PointCloud
from app.surface.normals import estimate_normals
from app.surface.step import parse_step
from benchmarks.peak_memory import own_peak_mb, peak_mb_of
from benchmarks.report import Row, at_least, at_most

_SIZES = (250_000, 1_000_000, 4_000_000)
_MIDDLE = np.array([0.0, 0.0, 50.0])
_RADIUS_MM, _NOISE_MM, _OUTLIERS = 40.0, 0.03, 0.005
_TASKS = ("statistical-outliers", "radius-outliers", "thin", "smooth", "normals")
_LIMITS = {
    ("statistical-outliers", 1_000_000): 3.0,
    ("radius-outliers", 1_000_000): 3.0,
    ("normals", 1_000_000): 3.0,
}
_STEP_MM = 0.4


def run() -> list[Row]:
    return [*_times(), *_outliers_found(), *_bent()]


def _times() -> list[Row]:
    rows = []
    for task in _TASKS:
        for size in _SIZES:
            cloud = _ball(size)
            start = time.perf_counter()
            _do(task, cloud)
            took_s = time.perf_counter() - start
            what, limit = f"{task}, {size / 1e6:g} million points", _LIMITS.get((task, size))
            rows.append(Row(what, took_s, "s") if limit is None else at_most(what, took_s, "s", limit))
            del cloud
            peak_mb = peak_mb_of("benchmarks.bench_cleaning", task, str(size))
            rows.append(Row(f"{what}: peak memory", peak_mb, "MB", note="whole process, cloud included"))
    return rows


def _do(task: str, cloud: PointCloud) -> None:
    if task == "normals":
        estimate_normals(cloud.points)
    else:
        parse_step({"kind": task}).apply(cloud)


def _outliers_found() -> list[Row]:
    cloud = _ball(1_000_000)
    is_planted = np.abs(np.linalg.norm(cloud.points - _MIDDLE, axis=1) - _RADIUS_MM) > 1.0
    marked = replace(cloud, quality=is_planted.astype(np.float32))
    rows = []
    for kind in ("statistical-outliers", "radius-outliers"):
        left = parse_step({"kind": kind}).apply(marked)
        found = 1.0 - np.count_nonzero(left.quality) / np.count_nonzero(is_planted)
        lost = 1.0 - np.count_nonzero(left.quality == 0.0) / np.count_nonzero(~is_planted)
        rows.append(
            at_least(
                f"{kind}: planted outliers found", 100.0 * float(found), "%", 95.0, "more than 1 mm away"
            )
        )
        rows.append(at_most(f"{kind}: good points lost", 100.0 * float(lost), "%", 2.0))
    return rows


def _bent() -> list[Row]:
    """What smoothing leaves of noise, of a step, and of a ball's radius."""
    rng = np.random.default_rng(1)
    points = np.column_stack([rng.uniform(-25.0, 25.0, (250_000, 2)), rng.normal(0.0, _NOISE_MM, 250_000)])
    is_upper = points[:, 0] > 0.0
    points[is_upper, 2] += _STEP_MM
    smooth = parse_step({"kind": "smooth"})
    stairs = smooth.apply(_cloud(points, np.tile([0.0, 0.0, 1.0], (len(points), 1))))
    height = stairs.points[:, 2].astype(np.float64)
    near = np.abs(points[:, 0]) < 0.3
    kept = height[near & is_upper].mean() - height[near & ~is_upper].mean()
    clean = _ball(250_000, outliers=0.0)
    before = np.linalg.norm(clean.points - _MIDDLE, axis=1)
    after = np.linalg.norm(smooth.apply(clean).points - _MIDDLE, axis=1)
    return [
        at_least(
            "smooth: height of a 0.4 mm step, 0.3 mm beside it", 100.0 * float(kept) / _STEP_MM, "%", 95.0
        ),
        at_most(
            "smooth: noise left on a level", 100.0 * float(height[~near & is_upper].std()) / _NOISE_MM, "%",
            50.0,
        ),
        Row("smooth: noise left on a ball of 40 mm radius", float(after.std() / before.std()) * 100.0, "%"),
        at_most("smooth: bias of the ball's radius", float(abs(after.mean() - before.mean())), "mm", 0.002),
    ]  # fmt: skip


def _ball(count: int, outliers: float = _OUTLIERS) -> PointCloud:
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = normals * (_RADIUS_MM + _NOISE_MM * rng.normal(size=(count, 1))) + _MIDDLE
    planted = rng.choice(count, int(outliers * count), replace=False)
    points[planted] = rng.uniform(-80.0, 80.0, (len(planted), 3)) + _MIDDLE
    return _cloud(points, normals)


def _cloud(points: np.ndarray, normals: np.ndarray) -> PointCloud:
    ones = np.ones(len(points), np.float32)
    return PointCloud(
        points.astype(np.float32), normals.astype(np.float32), np.full((len(points), 3), 128, np.uint8),
        _NOISE_MM * ones, np.zeros(len(points), np.uint8), 0.0 * ones, ones, ("left",),
    )  # fmt: skip


if __name__ == "__main__":
    _do(sys.argv[1], _ball(int(sys.argv[2])))
    print(own_peak_mb())
