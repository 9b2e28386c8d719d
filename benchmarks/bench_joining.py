"""Joining two scans of one thing: how often it is found and how well, what fusing does to noise, and time."""

import time
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from trimesh import Trimesh
from trimesh.sample import sample_surface

from app.errors import SurfaceError
from app.geometry.arrays import Floats, Points
from app.geometry.cloud import PointCloud
from app.geometry.transform import RigidTransform
from app.simulation.mesh import Mesh
from app.simulation.objects import make_object
from app.surface.joining.join import Joined, join
from app.surface.joining.options import JoinOptions
from benchmarks.report import Row, at_least, at_most
from benchmarks.seen_points import put_down, seen

_OBJECTS = ("mug", "rabbit")
_EACH = 25
_MOST_MM = 0.05
_POINTS, _MANY_POINTS = 40_000, 450_000
_TRUE_POINTS = 1_500_000
_SIDEWAYS, _OVER = 0.5 * np.pi, np.pi
_NEAR_MM = 0.4
_STRAY_MM = 0.3


@dataclass(frozen=True, eq=False, slots=True)
class Attempt:
    """One join of two scans.

    Attributes:
        error_mm: RMS over the second scan's points of how far they are from where they belong; infinite
            where nothing was found.
        is_sure: whether the program trusted it.
        seconds, cpu_s: that it took.
    """

    error_mm: float
    is_sure: bool
    seconds: float
    cpu_s: float


def run() -> list[Row]:
    rows: list[Row] = []
    attempts: list[Attempt] = []
    for name in _OBJECTS:
        found = [attempt(name, number) for number in range(_EACH)]
        attempts += found
        errors = [each.error_mm for each in found]
        within = sum(error <= _MOST_MM for error in errors)
        worst = f"worst {max(errors):.4f} mm; {sum(each.is_sure for each in found)} without a doubt"
        rows.append(at_least(f"{name}: joined within {_MOST_MM} mm, of {_EACH}", within, "", _EACH, worst))
    seconds = float(np.median([each.seconds for each in attempts]))
    note = f"{np.median([each.cpu_s for each in attempts]):.1f} s of computing"
    rows.append(Row(f"a join of two scans of {_POINTS // 1000} thousand points", seconds, "s", note=note))
    for name in _OBJECTS:
        rows += _fusion(name)
    return rows


def attempt(name: str, number: int) -> Attempt:
    """The thing upright, and lying on any side (even numbers) or turned over (odd ones)."""
    mesh = make_object(name).mesh
    rng = np.random.default_rng(number)
    first, second, upright, tilted = _two_scans(mesh, _POINTS, _OVER if number % 2 else _SIDEWAYS, rng)
    start, start_cpu = time.perf_counter(), time.process_time()
    try:
        joined = join([first, second])
    except SurfaceError:
        return Attempt(np.inf, False, time.perf_counter() - start, time.process_time() - start_cpu)
    seconds, cpu_s = time.perf_counter() - start, time.process_time() - start_cpu
    placed = joined.placements[1]
    error = pose_error_mm(placed.pose, upright @ tilted.inverse(), tilted @ mesh.vertices)
    return Attempt(error, placed.is_sure, seconds, cpu_s)


def pose_error_mm(found: RigidTransform, truth: RigidTransform, points: Points) -> float:
    """RMS distance of points (N, 3) moved by the one and by the other."""
    return float(np.sqrt(np.mean(np.sum((found @ points - truth @ points) ** 2, axis=1))))


def _two_scans(
    mesh: Mesh, count: int, tilt_rad: float, rng: np.random.Generator
) -> tuple[PointCloud, PointCloud, RigidTransform, RigidTransform]:
    """Upright, and tilted about any horizontal line; and where the thing stood."""
    way = rng.uniform(0.0, 2.0 * np.pi)
    upright = put_down(mesh, np.zeros(3), rng)
    tilted = put_down(mesh, tilt_rad * np.array([np.cos(way), np.sin(way), 0.0]), rng)
    return seen(mesh, upright, count, rng), seen(mesh, tilted, count, rng), upright, tilted


def _fusion(name: str) -> list[Row]:
    mesh = make_object(name).mesh
    first, second, upright, _ = _two_scans(mesh, _MANY_POINTS, _SIDEWAYS, np.random.default_rng(7))
    raw = join([first, second], JoinOptions(is_fused=False))
    start, start_cpu = time.perf_counter(), time.process_time()
    fused = join([first, second])
    seconds, cpu_s = time.perf_counter() - start, time.process_time() - start_cpu
    truth = Trimesh(upright @ mesh.vertices, mesh.faces, process=False)
    samples, faces = sample_surface(truth, _TRUE_POINTS, seed=1)
    tree, normals = cKDTree(samples), truth.face_normals[faces]
    is_mean = fused.cloud.sigma_mm < 0.9 * raw.cloud.sigma_mm.min()
    means = fused.cloud.points[is_mean].astype(np.float64)
    all_points = raw.cloud.points.astype(np.float64)
    is_near = cKDTree(means).query(all_points, workers=-1)[0] < _NEAR_MM

    def noise(points: Points) -> float:
        nearest = tree.query(points, workers=-1)[1]
        away: Floats = np.einsum("ij,ij->i", points - samples[nearest], normals[nearest])
        return float(np.sqrt(np.mean(away[np.abs(away) < _STRAY_MM] ** 2)))

    single, mean = noise(all_points[is_near]), noise(means)
    note = f"{single:.4f} mm before, {mean:.4f} mm after; 0.707 is the best that two can do"
    size = f"{len(first) // 1000} and {len(second) // 1000} thousand points"
    return [
        at_most(f"{name}: noise where scans overlap, fused by single", mean / single, "", 0.8, note),
        Row(f"{name}: a join of {size}", seconds, "s", note=f"{cpu_s:.1f} s of computing, {_told(fused)}"),
    ]


def _told(joined: Joined) -> str:
    placed = joined.placements[1]
    return f"overlap {100.0 * placed.overlap:.0f} %, residual {placed.residual_mm:.3f} mm"
