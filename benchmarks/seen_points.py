"""Scans of simulated objects in a second: what a camera sees while the table turns, without pictures."""

import numpy as np
from numpy.typing import NDArray
from trimesh import Trimesh
from trimesh.sample import sample_surface

from app.geometry.arrays import Floats, Points
from app.geometry.cloud import PointCloud
from app.geometry.transform import RigidTransform, rotation_about, rotation_from_rvec
from app.simulation.mesh import Mesh

NOISE_MM = 0.03
_CAMERA_MM = np.array([250.0, 0.0, 130.0])
_VIEWS = 24
_PIXELS_PER_MM = 0.8
_COVER = 120_000
_HIDDEN_MM = 1.5
_LEAST_FACING = 0.2
_TABLE_RADIUS_MM, _TABLE_SHARE = 80.0, 0.15
_UP = np.array([0.0, 0.0, 1.0])


def put_down(
    mesh: Mesh, tilt_rvec: Floats, rng: np.random.Generator, shift_mm: float = 12.0
) -> RigidTransform:
    """The table's frame from the object's: tilted, then put down somewhere, any way round."""
    rotation = rotation_about(_UP, rng.uniform(0.0, 2.0 * np.pi)) @ rotation_from_rvec(tilt_rvec)
    low, high = (mesh.vertices @ rotation.T).min(axis=0), (mesh.vertices @ rotation.T).max(axis=0)
    middle = (low + high) / 2.0
    shift = np.append(rng.uniform(-shift_mm, shift_mm, 2) - middle[:2], -low[2])
    return RigidTransform(rotation, shift)


def seen(
    mesh: Mesh, pose: RigidTransform, count: int, rng: np.random.Generator, noise_mm: float = NOISE_MM
) -> PointCloud:
    """About so many points of what a camera 27 degrees above the table sees of the object, and of the table.

    Noise is along the normals. Hidden parts are found with a depth picture of each view.

    Args:
        pose: the table's frame from the object's.
        count: of points on the object's whole surface; those that are not seen are left out.
    """
    truth = Trimesh(pose @ mesh.vertices, mesh.faces, process=False)
    points, faces = sample_surface(truth, count, seed=int(rng.integers(1 << 30)))
    normals = np.asarray(truth.face_normals[faces], np.float64)
    albedo = mesh.albedo[mesh.faces[faces]].mean(axis=1)[:, ::-1]
    cover, _ = sample_surface(truth, _COVER, seed=1)
    best = np.full(len(points), _LEAST_FACING)
    angle = np.full(len(points), np.nan)
    for turn in np.arange(_VIEWS) * 2.0 * np.pi / _VIEWS + rng.uniform(0.0, 0.1):
        camera = rotation_about(_UP, turn) @ _CAMERA_MM
        towards = camera - points
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        facing = np.einsum("ij,ij->i", normals, towards)
        is_seen = (facing > best) & ~_is_hidden(points, cover, camera)
        best[is_seen], angle[is_seen] = facing[is_seen], -np.degrees(turn) % 360.0
    kept = np.isfinite(angle)
    points, normals = np.asarray(points)[kept], normals[kept]
    points = points + noise_mm * rng.normal(size=(len(points), 1)) * normals
    table = _table(points, int(_TABLE_SHARE * len(points)), noise_mm, rng)
    n = len(points) + len(table)
    ones = np.ones(n, np.float32)
    return PointCloud(
        np.concatenate([points, table]).astype(np.float32),
        np.concatenate([normals, np.tile(_UP, (len(table), 1))]).astype(np.float32),
        np.concatenate([255.0 * albedo[kept], np.full((len(table), 3), 40.0)]).astype(np.uint8),
        noise_mm * ones, np.zeros(n, np.uint8),
        np.concatenate([angle[kept], rng.uniform(0.0, 360.0, len(table))]).astype(np.float32), ones,
        ("left",),
    )  # fmt: skip


def _is_hidden(points: Points, cover: Points, camera: Floats) -> NDArray[np.bool_]:
    """(N,) which of points have something between them and the camera."""
    forward = -camera / np.linalg.norm(camera)
    right = np.cross(forward, _UP)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(right, forward), forward])
    pixels = _PIXELS_PER_MM * np.linalg.norm(camera)

    def pictured(places: Points) -> tuple[NDArray[np.int64], Floats]:
        x, y, depth = axes @ (places - camera).T
        place = np.rint(np.stack([x, y]) / depth * pixels).astype(np.int64) + 1000
        return place[0] * 2000 + place[1], depth

    where, depth = pictured(cover)
    nearest = np.full(2000 * 2000, np.inf)
    np.minimum.at(nearest, where, depth)
    where, depth = pictured(points)
    return np.asarray(depth > nearest[where] + _HIDDEN_MM)


def _table(points: Points, count: int, noise_mm: float, rng: np.random.Generator) -> Points:
    """On the table, beside the thing."""
    radius = _TABLE_RADIUS_MM * np.sqrt(rng.random(count))
    turn = rng.uniform(0.0, 2.0 * np.pi, count)
    table = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), noise_mm * rng.normal(size=count)])
    taken = {tuple(cell) for cell in (points[:, :2] // 4.0).astype(int)}
    is_free = np.array([tuple(cell) not in taken for cell in (table[:, :2] // 4.0).astype(int)], np.bool_)
    return np.asarray(table[is_free])
