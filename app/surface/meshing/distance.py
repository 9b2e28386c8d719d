"""How far points lie from the triangles of a mesh."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from app.geometry.arrays import Floats, Points
from app.geometry.mesh import TriangleMesh

_CANDIDATES = 8
_SAMPLES = 200_000


def distances_to(mesh: TriangleMesh, points: Points) -> Floats:
    """(N,) mm from points to the nearest triangle, exact for all but a few at odd places, never too small.

    The triangles to look at are those of the nearest of many samples of the surface.
    """
    corners = mesh.corners()
    samples, owners = _sampled(corners)
    count = min(_CANDIDATES, len(samples))
    _, near = cKDTree(samples).query(points, k=np.arange(1, count + 1), workers=-1)
    best = np.full(len(points), np.inf)
    for column in owners[near].T:
        np.minimum(best, _point_to_triangle(points, corners[column]), out=best)
    return best


def _sampled(corners: Floats) -> tuple[Points, NDArray[np.intp]]:
    """Centres of all triangles, more points on the larger ones, and whose each is."""
    a, b, c = np.moveaxis(corners, 1, 0)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    rng = np.random.default_rng(0)
    total = max(float(areas.sum()), 1e-12)
    more = np.floor(areas / total * _SAMPLES + rng.uniform(size=len(areas))).astype(np.int64)
    owners = np.repeat(np.arange(len(areas)), more)
    u, v = rng.uniform(size=(2, len(owners)))
    is_over = u + v > 1.0
    u[is_over], v[is_over] = 1.0 - u[is_over], 1.0 - v[is_over]
    spread = a[owners] + u[:, None] * (b - a)[owners] + v[:, None] * (c - a)[owners]
    return np.concatenate([corners.mean(axis=1), spread]), np.concatenate([np.arange(len(areas)), owners])


def _point_to_triangle(points: Points, corners: Floats) -> Floats:
    """(N,) mm from each point to its own triangle, (N, 3, 3)."""
    a, b, c = np.moveaxis(corners, 1, 0)
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1)
    is_flat = length < 1e-12
    normal /= np.where(is_flat, 1.0, length)[:, None]
    is_above = ~is_flat
    nearest = np.full(len(points), np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        along, away = end - start, points - start
        squared = np.einsum("ij,ij->i", along, along)
        part = np.clip(np.einsum("ij,ij->i", away, along) / np.maximum(squared, 1e-24), 0.0, 1.0)
        nearest = np.minimum(nearest, np.linalg.norm(away - part[:, None] * along, axis=1))
        is_above &= np.einsum("ij,ij->i", np.cross(along, away), normal) >= 0.0
    heights = np.abs(np.einsum("ij,ij->i", points - a, normal))
    return np.where(is_above, heights, nearest)
