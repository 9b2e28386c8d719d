"""Normals for clouds that have none, such as those of other programs."""

import math
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats, Points
from app.geometry.cloud import PointCloud
from app.surface.neighbours import Places, cell_keys, is_finite, surroundings
from app.surface.view_direction import knows_angles, towards_camera

_NEIGHBOURS = 12
# A neighbourhood that is so much longer than wide is a line, and has no normal.
_LEAST_WIDTH = 1e-4
# Neighbourhoods that are worked on at once: they stay in the processor's cache.
_IN_CACHE = 8_192
_MOST_PATCHES = 20_000
_PATCH_SPACINGS = 5.0
_PATCH_NEIGHBOURS = 8
_EXTREME = 0.01


def has_normals(cloud: PointCloud) -> bool:
    """Whether most points know which way their surface faces."""
    return bool(2 * np.count_nonzero(np.any(cloud.normals != 0.0, axis=1)) > len(cloud))


def with_normals(cloud: PointCloud, neighbours: int = _NEIGHBOURS) -> PointCloud:
    """The cloud, with normals where points had none; those there were stay.

    Raises:
        SurfaceError: there are too many points.
    """
    is_missing = ~np.any(cloud.normals != 0.0, axis=1) & is_finite(cloud.points)
    if not is_missing.any():
        return cloud
    found = estimate_normals(cloud.points, neighbours)
    if knows_angles(cloud):
        found[np.einsum("ij,ij->i", found, towards_camera(cloud)) < 0.0] *= -1.0
    return replace(cloud, normals=np.where(is_missing[:, None], found, cloud.normals).astype(np.float32))


def estimate_normals(points: NDArray[np.float32], neighbours: int = _NEIGHBOURS) -> NDArray[np.float32]:
    """Unit normals (N, 3) out of the surface; zeros where a point is not finite or its surroundings a line.

    Each is the direction in which its neighbours spread least. Which of its two ends is outside is passed on
    from patch to patch, beginning where the cloud ends: there outside is away from it.

    Args:
        points: (N, 3) mm.
        neighbours: how many make the normal: more for noise, fewer for detail.

    Raises:
        SurfaceError: there are too many points.
    """
    normals = np.zeros((len(points), 3), np.float32)
    usable = is_finite(points)
    places = Places.of(points[usable])
    if len(places) < 3:
        return normals
    unsigned = least_spread(places, neighbours)
    signed = _turned_outwards(places, unsigned)
    normals[usable] = signed[places.of_point]
    return normals


def least_spread(places: Places, neighbours: int = _NEIGHBOURS) -> NDArray[np.float32]:
    """(M, 3) unit vectors, either way round, in which the neighbours of each place spread least."""
    found = np.zeros((len(places), 3), np.float32)
    if not len(places):
        return found
    # About the middle, single precision is finer than the points themselves, and half as much to move.
    middle, reach = surroundings(places.points)
    x, y, z = np.ascontiguousarray(((places.points - middle) / reach).T, np.float32)
    count = np.arange(1, min(neighbours, len(places)) + 1)

    def work(start: int) -> None:
        part = slice(start, start + _IN_CACHE)
        _, near = places.tree.query(places.points[part], k=count)
        found[part] = _smallest_eigenvector(_spreads([axis[near] for axis in (x, y, z)]))

    # Search and arithmetic both let other threads run: every core has its own piece.
    with ThreadPoolExecutor(os.cpu_count()) as threads:
        list(threads.map(work, range(0, len(places), _IN_CACHE)))
    return found


def _spreads(columns: list[NDArray[np.float32]]) -> Floats:
    """(6, N) sums of products of x, y and z (N, K) about their mean: xx, yy, zz, xy, xz, yz."""
    for column in columns:
        column -= column.mean(axis=1, keepdims=True)
    pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    sums = [np.einsum("nk,nk->n", columns[one], columns[other]) for one, other in pairs]
    return np.stack(sums).astype(np.float64)


def _smallest_eigenvector(spread: Floats) -> Floats:
    """(N, 3) of symmetric matrices (6, N) as xx, yy, zz, xy, xz, yz; zeros where two are as small.

    In closed form, with the cosine: many times as fast as an iteration for each of a million matrices.
    """
    scale = np.maximum(spread[:3].sum(axis=0), 1e-300)
    xx, yy, zz, xy, xz, yz = spread / scale
    mean = (xx + yy + zz) / 3.0
    ax, ay, az = xx - mean, yy - mean, zz - mean
    off = xy * xy + xz * xz + yz * yz
    size = np.sqrt(np.maximum((ax * ax + ay * ay + az * az + 2.0 * off) / 6.0, 1e-300))
    determinant = ax * (ay * az - yz * yz) - xy * (xy * az - yz * xz) + xz * (xy * yz - ay * xz)
    angle = np.arccos(np.clip(determinant / (2.0 * size**3), -1.0, 1.0)) / 3.0
    smallest = mean + 2.0 * size * np.cos(angle + 2.0 * np.pi / 3.0)
    largest = mean + 2.0 * size * np.cos(angle)
    middle = 3.0 * mean - smallest - largest
    rows = (
        np.stack([xx - smallest, xy, xz]), np.stack([xy, yy - smallest, yz]),
        np.stack([xz, yz, zz - smallest]),
    )  # fmt: skip
    best, best_length = np.zeros_like(rows[0]), np.zeros(len(xx))
    for one, other in ((0, 1), (0, 2), (1, 2)):
        (ux, uy, uz), (vx, vy, vz) = rows[one], rows[other]
        crossed = np.stack([uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx])
        length = np.einsum("cn,cn->n", crossed, crossed)
        is_longer = length > best_length
        best[:, is_longer], best_length[is_longer] = crossed[:, is_longer], length[is_longer]
    is_known = (middle - smallest > _LEAST_WIDTH) & (best_length > 0.0)
    vectors: Floats = np.where(is_known, best / np.sqrt(np.maximum(best_length, 1e-300)), 0.0).T
    return vectors


def _turned_outwards(places: Places, normals: NDArray[np.float32]) -> NDArray[np.float32]:
    """The same, each of them out of the surface."""
    # A few points far away must not make the patches of all others larger.
    around, reach = surroundings(places.points)
    points = np.clip(places.points, around - reach, around + reach)
    extent = float(np.ptp(points, axis=0).max())
    spacing = places.spacing_mm()
    # Points strewn at random lie twice as far apart as the usual distance to the nearest of them.
    size = spacing * max(_PATCH_SPACINGS, 2.0 * math.sqrt(2.0 * len(places) / _MOST_PATCHES))
    size = max(size, extent / (1 << 20))
    while True:
        _, patch = np.unique(cell_keys(points, size), return_inverse=True)
        count = int(patch.max()) + 1
        if count <= _MOST_PATCHES:
            break
        size *= 1.5
    # The mean of a patch's normals, each turned to one of them.
    first = np.zeros(count, np.intp)
    first[patch[::-1]] = np.arange(len(places))[::-1]
    turned = np.where(np.einsum("ij,ij->i", normals, normals[first][patch]) < 0.0, -1.0, 1.0)
    aligned = normals * turned[:, None]
    middle, mean = np.empty((count, 3)), np.empty((count, 3))
    members = np.bincount(patch, minlength=count)
    for axis in range(3):
        middle[:, axis] = np.bincount(patch, points[:, axis], count) / members
        mean[:, axis] = np.bincount(patch, aligned[:, axis], count)
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-12)
    sign = _signs(middle, mean)
    signed: NDArray[np.float32] = normals.copy()
    # Each point follows its patch, whichever way it was turned itself.
    inwards = np.einsum("ij,ij->i", normals, (sign[:, None] * mean)[patch]) < 0.0
    signed[inwards] *= -1.0
    return signed


def _signs(middle: Points, normals: Floats) -> Floats:
    """(P,) one or minus one for each patch, so that neighbours agree and the ends look outwards."""
    near = Places.of(middle)
    count = min(_PATCH_NEIGHBOURS, len(near))
    starts, ends = [], []
    # As in `Places.of`.
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree

    for part, _, numbers in near.nearest(count):
        starts.append(np.repeat(np.arange(part.start, part.stop), count))
        ends.append(numbers.ravel())
    start, end = near.first[np.concatenate(starts)], near.first[np.concatenate(ends)]
    start, end = start[start != end], end[start != end]
    unlike = 1.0 - np.abs(np.einsum("ij,ij->i", normals[start], normals[end]))
    apart = middle[end] - middle[start]
    # Neighbours across a thin wall lie along each other's normal: a surface is not followed through it.
    along = np.abs(np.einsum("ij,ij->i", apart, normals[start])) / np.linalg.norm(apart, axis=1)
    shape = (len(middle), len(middle))
    graph = coo_array((unlike + along + 1e-3, (start, end)), shape).tocsr()
    tree = minimum_spanning_tree(graph.maximum(graph.T))
    tree = tree + tree.T
    sign = np.ones(len(middle))
    pieces, piece = connected_components(tree, directed=False)
    order = np.argsort(piece, kind="stable")
    for members in np.split(order, np.cumsum(np.bincount(piece, minlength=pieces))[:-1]):
        visited, before = breadth_first_order(tree, members[0], directed=False)
        for each in visited[1:]:
            parent = before[each]
            agree = normals[each] @ normals[parent]
            sign[each] = sign[parent] if agree >= 0.0 else -sign[parent]
        if _looks_inwards(middle[members], sign[members, None] * normals[members]):
            sign[members] *= -1.0
    return sign


def _looks_inwards(points: Points, normals: Floats) -> bool:
    """Whether the outermost points along each axis face the middle rather than away from it."""
    vote = 0.0
    for axis in range(3):
        for side in (-1.0, 1.0):
            level = side * points[:, axis]
            outermost = level >= np.quantile(level, 1.0 - _EXTREME)
            vote += side * float(normals[outermost, axis].mean())
    return vote < 0.0
