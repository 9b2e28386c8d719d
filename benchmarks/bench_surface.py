"""Meshes of clouds: time and memory by the number of points, and how near they come to the truth."""

import subprocess
import sys
import time

import numpy as np
from scipy.spatial import cKDTree
from trimesh import Trimesh
from trimesh.sample import sample_surface

from app.geometry.arrays import Points
from app.geometry.cloud import PointCloud
from app.simulation.objects import make_object
from app.surface.finish import Finish, Preset, finish
from app.surface.meshing.topology import is_watertight
from benchmarks.peak_memory import own_peak_mb
from benchmarks.report import Row, at_most

_COUNTS = (250_000, 1_000_000, 4_000_000)
_OBJECTS = {"sphere": 0.06, "mug": 0.1, "rabbit": 0.1}
_POINTS = 200_000
_NOISE_MM = 0.03
# What no scanner sees: sides that face down, this near the table.
_UNSEEN_BELOW_MM = 1.0
_TRUE_POINTS = 1_500_000
_SEEN_WITHIN_MM = 0.5


def run() -> list[Row]:
    rows = []
    for count in _COUNTS:
        seconds, cpu_s, peak_mb = _timed(count)
        note = f"{cpu_s:.0f} s of computing; more is waiting for others who use the machine"
        name = f"finish for print, {count / 1e6:g} million points of a mug"
        if count == 1_000_000:
            rows += [
                at_most(name, seconds, "s", 60.0, note),
                at_most(f"{name}: peak memory", peak_mb, "MB", 4096.0),
            ]
        else:
            rows += [Row(name, seconds, "s", note=note), Row(f"{name}: peak memory", peak_mb, "MB")]
    for name, limit in _OBJECTS.items():
        rows += _accuracy(name, limit)
    return rows


def _accuracy(name: str, limit_mm: float) -> list[Row]:
    """Of vertices near seen points, against the object's own surface."""
    cloud = _cloud(name, _POINTS)
    done = finish([cloud], Finish(preset=Preset.PRINT, steps=()))
    assert done.mesh is not None
    truth, normals = _sampled(name, _TRUE_POINTS, np.random.default_rng(1))
    vertices = done.mesh.vertices.astype(np.float64)
    seen = vertices[cKDTree(cloud.points).query(vertices, workers=-1)[0] < _SEEN_WITHIN_MM]
    nearest = cKDTree(truth).query(seen, workers=-1)[1]
    errors = np.einsum("ij,ij->i", seen - truth[nearest], normals[nearest])
    note = f"{_POINTS:,} points, {_NOISE_MM} mm noise, {len(done.mesh):,} triangles"
    closed = Row(f"{name}: watertight", float(is_watertight(done.mesh)), "", "1", is_watertight(done.mesh))
    return [
        at_most(f"{name}: RMS from the truth", float(np.sqrt(np.mean(errors**2))), "mm", limit_mm, note),
        closed,
    ]


def _timed(count: int) -> tuple[float, float, float]:
    """Seconds, seconds of computing and peak MB of a process that finishes so many points."""
    command = [sys.executable, "-m", "benchmarks.bench_surface", str(count)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    seconds, cpu_s, peak_mb = map(float, done.stdout.split()[-3:])
    return seconds, cpu_s, peak_mb


def _cloud(name: str, count: int) -> PointCloud:
    rng = np.random.default_rng(0)
    points, normals = _sampled(name, count, rng)
    points = points + _NOISE_MM * rng.normal(size=(len(points), 1)) * normals
    seen = ~((normals[:, 2] < -0.5) & (points[:, 2] < _UNSEEN_BELOW_MM))
    points, normals = points[seen], normals[seen]
    ones = np.ones(len(points), np.float32)
    return PointCloud(
        points.astype(np.float32), normals.astype(np.float32), np.full((len(points), 3), 128, np.uint8),
        _NOISE_MM * ones, np.zeros(len(points), np.uint8), 0.0 * ones, ones, ("left",),
    )  # fmt: skip


def _sampled(name: str, count: int, rng: np.random.Generator) -> tuple[Points, Points]:
    """Points on the true surface, and its normals there."""
    truth = make_object(name).mesh
    mesh = Trimesh(truth.vertices, truth.faces, process=False)
    points, faces = sample_surface(mesh, count, seed=int(rng.integers(1 << 30)))
    return np.asarray(points, np.float64), np.asarray(mesh.face_normals[faces], np.float64)


if __name__ == "__main__":
    made = _cloud("mug", int(sys.argv[1]))
    start, start_cpu = time.perf_counter(), time.process_time()
    finish([made], Finish(preset=Preset.PRINT))
    print(time.perf_counter() - start, time.process_time() - start_cpu, own_peak_mb())
