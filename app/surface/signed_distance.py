"""How far points lie outside or inside of a mesh or a cloud."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.errors import SurfaceError
from app.geometry.arrays import Floats, Points
from app.geometry.cloud import PointCloud
from app.geometry.mesh import TriangleMesh
from app.surface.neighbours import Places, is_finite

_SAMPLES = 300_000
_CANDIDATES = 6
_AT_ONCE = 200_000
# Nearest points of two triangles that are no further apart than this are one: their common edge.
_SAME_MM = 1e-6
_NEIGHBOURS = 4
_REACH_SPACINGS = 4.0


def distances_to_mesh(points: NDArray[Any], mesh: TriangleMesh) -> Floats:
    """(N,) mm from finite points (N, 3) to the nearest triangle, positive where the triangle faces the point.

    The triangles that are looked at are those nearest among many places spread over the mesh.

    Raises:
        SurfaceError: the mesh has no triangle with an area.
    """
    # As in `Places.of`.
    from scipy.spatial import cKDTree

    corners = mesh.corners()
    normals = mesh.face_vectors()
    areas = np.linalg.norm(normals, axis=1)
    is_flat = ~(areas > 1e-12 * max(float(areas.max(initial=0.0)), 1e-300))
    corners, normals, areas = corners[~is_flat], normals[~is_flat], areas[~is_flat]
    if not len(corners):
        raise SurfaceError("There are no triangles to measure against.")
    normals /= areas[:, None]
    samples, owner = _spread(corners, areas)
    tree = cKDTree(samples)
    count = min(_CANDIDATES, len(samples))
    signed = np.empty(len(points))
    for start in range(0, len(points), _AT_ONCE):
        asked = points[start : start + _AT_ONCE].astype(np.float64)
        _, near = tree.query(asked, k=np.arange(1, count + 1), workers=-1)
        signed[start : start + _AT_ONCE] = _to_candidates(asked, corners, normals, owner[near])
    return signed


def distances_to_cloud(points: NDArray[Any], cloud: PointCloud) -> tuple[Floats, bool]:
    """(N,) mm from finite points (N, 3) to a cloud, and whether they have a sign.

    Where the cloud has normals, to the plane of its nearest points, positive outside; beyond its end, and
    without normals, to the nearest point.

    Raises:
        SurfaceError: the cloud is empty or too large.
    """
    known = is_finite(cloud.points)
    places = Places.of(cloud.points[known])
    if not len(places):
        raise SurfaceError("There are no points to measure against.")
    normals = cloud.normals[known][places.first].astype(np.float64)
    has_sign = bool(np.mean(np.any(normals != 0.0, axis=1)) > 0.5)
    reach = _REACH_SPACINGS * places.spacing_mm()
    result = np.empty(len(points))
    asked = points.astype(np.float64)
    for part, distances, numbers in places.nearest(min(_NEIGHBOURS, len(places)), asked):
        nearest = distances[:, 0]
        if not has_sign:
            result[part] = nearest
            continue
        there = normals[numbers]
        apart = asked[part][:, None] - places.points[numbers]
        heights = np.einsum("nki,nki->nk", apart, there)
        is_known = np.any(there != 0.0, axis=2)
        height = np.where(is_known, heights, 0.0).sum(axis=1) / np.maximum(is_known.sum(axis=1), 1)
        sideways = np.sqrt(np.maximum(nearest**2 - heights[:, 0] ** 2, 0.0))
        is_beside = (sideways > max(reach, 1e-9)) | ~is_known.any(axis=1)
        result[part] = np.where(is_beside, np.where(height < 0.0, -nearest, nearest), height)
    return result, has_sign


def _spread(corners: Floats, areas: Floats) -> tuple[Points, NDArray[np.intp]]:
    """Places on the triangles, the more the larger, one at least; and whose each is."""
    rng = np.random.default_rng(0)
    many = 1 + np.floor(areas / areas.sum() * _SAMPLES).astype(np.int64)
    owner = np.repeat(np.arange(len(corners)), many)
    u, v = rng.random((2, len(owner)))
    is_over = u + v > 1.0
    u[is_over], v[is_over] = 1.0 - u[is_over], 1.0 - v[is_over]
    a, b, c = np.moveaxis(corners[owner], 1, 0)
    return a + u[:, None] * (b - a) + v[:, None] * (c - a), owner


def _to_candidates(points: Points, corners: Floats, normals: Floats, candidates: NDArray[np.intp]) -> Floats:
    """(N,) signed distance to the nearest of each point's own triangles (N, K)."""
    best, facing = np.full(len(points), np.inf), np.zeros(len(points))
    for triangle in candidates.T:
        apart = points - _nearest_on(points, corners[triangle])
        away = np.linalg.norm(apart, axis=1)
        towards = np.einsum("ij,ij->i", apart, normals[triangle])
        # At an edge that two triangles share, the one that faces the point more squarely knows its side.
        is_same = np.abs(away - best) <= _SAME_MM
        is_better = (away < best - _SAME_MM) | (is_same & (np.abs(towards) > np.abs(facing)))
        best = np.where(is_better, away, best)
        facing = np.where(is_better, towards, facing)
    signed: Floats = np.where(facing < 0.0, -best, best)
    return signed


def _nearest_on(points: Points, corners: Floats) -> Points:
    """(N, 3) the place of each triangle (N, 3, 3) that is nearest to its point."""
    a, b, c = np.moveaxis(corners, 1, 0)
    ab, ac, ap = b - a, c - a, points - a
    d00, d01, d11 = _dot(ab, ab), _dot(ab, ac), _dot(ac, ac)
    d20, d21 = _dot(ap, ab), _dot(ap, ac)
    scale = d00 * d11 - d01 * d01
    v, w = (d11 * d20 - d01 * d21) / scale, (d00 * d21 - d01 * d20) / scale
    is_within = (v >= 0.0) & (w >= 0.0) & (v + w <= 1.0)
    nearest = a + v[:, None] * ab + w[:, None] * ac
    outside = np.flatnonzero(~is_within)
    if len(outside):
        best, least = nearest[outside], np.full(len(outside), np.inf)
        for start, end in ((a, b), (b, c), (c, a)):
            begin, along = start[outside], (end - start)[outside]
            part = np.clip(_dot(points[outside] - begin, along) / _dot(along, along), 0.0, 1.0)
            place = begin + part[:, None] * along
            away = np.linalg.norm(points[outside] - place, axis=1)
            best = np.where((away < least)[:, None], place, best)
            least = np.minimum(away, least)
        nearest[outside] = best
    return np.asarray(nearest, np.float64)


def _dot(one: Floats, other: Floats) -> Floats:
    product: Floats = np.einsum("ij,ij->i", one, other)
    return product
