"""Vertices moved to where the points around them say the surface is."""

import numpy as np
from scipy.spatial import cKDTree

from app.geometry.arrays import Floats, Points

_NEIGHBOURS = 24
_FARTHEST_SIGMAS = 3.0
_AT_ONCE = 200_000


def snap(
    vertices: Points, outward: Points, tree: cKDTree, normals: Points, weights: Floats, sigma_mm: float
) -> Points:
    """Move vertices along their normals onto the surface that the points tell; those far from all stay.

    The distance is the mean of that to the points' tangent planes and that of the points to the vertex's own:
    one is too large by the curvature, the other too small by as much, and a curved surface does not shrink.

    Args:
        vertices, outward: (V, 3) mm and unit vectors.
        tree: of the points (N, 3) mm.
        normals: (N, 3) their unit vectors.
        weights: (N,) of each point, such as one by its variance.
        sigma_mm: over how much of the surface is averaged.

    Returns:
        (V, 3) mm.
    """
    moved = vertices.copy()
    for first in range(0, len(vertices), _AT_ONCE):
        part = slice(first, first + _AT_ONCE)
        shift = _shift(vertices[part], outward[part], tree, normals, weights, sigma_mm)
        moved[part] += shift[:, None] * outward[part]
    return moved


def _shift(
    vertices: Points, outward: Points, tree: cKDTree, normals: Points, weights: Floats, sigma_mm: float
) -> Floats:
    count = min(_NEIGHBOURS, len(normals))
    farthest_mm = _FARTHEST_SIGMAS * sigma_mm
    distances, which = tree.query(
        vertices, k=np.arange(1, count + 1), distance_upper_bound=farthest_mm, workers=-1
    )
    is_there = np.isfinite(distances)
    which = np.where(is_there, which, 0)
    away = np.asarray(tree.data)[which] - vertices[:, None, :]
    theirs = normals[which]
    agreement = np.einsum("vnk,vk->vn", theirs, outward)
    weight = np.exp(-0.5 * (distances / sigma_mm) ** 2) * weights[which] * np.maximum(agreement, 0.0)
    weight[~is_there] = 0.0
    height = 0.5 * (np.einsum("vnk,vnk->vn", theirs, away) + np.einsum("vnk,vk->vn", away, outward))
    total = weight.sum(axis=1)
    shift = np.einsum("vn,vn->v", weight, height) / np.where(total > 0.0, total, 1.0)
    shifts: Floats = np.clip(shift, -sigma_mm, sigma_mm)
    return shifts
