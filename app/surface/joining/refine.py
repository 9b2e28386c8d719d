"""Poses of several scans, made to agree all at once where they lie on each other."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from app.geometry.arrays import Floats, Points
from app.geometry.transform import RigidTransform, rotation_from_rvec
from app.surface.joining.sample import Sample

_ALIKE = 0.7
# Fewer searches are done before the threads are started.
_MANY = 20_000
_MAD_TO_SIGMA = 1.4826
# Residuals beyond so many sigmas count for nothing,
_TUKEY = 4.0
# but not those within such a share of the reach: what agrees already, such as a round wall, must not outvote
# the little that holds it along, such as a handle, before that has come near.
_LEAST_LIMIT = 0.06
# Steps of such a share of the reach change nothing.
_STILL = 1e-4


@dataclass(frozen=True, eq=False, slots=True)
class Searched:
    """A sample that can be asked for its nearest points."""

    sample: Sample
    tree: cKDTree

    @classmethod
    def of(cls, sample: Sample) -> Self:
        return cls(sample, cKDTree(sample.points, balanced_tree=False, compact_nodes=False))


@dataclass(frozen=True, eq=False, slots=True)
class Partners:
    """Points of one scan with those of another one that lie on the same piece of surface, in a common frame.

    Attributes:
        which, theirs: (N,) numbers of the points in the one and the other scan.
        points: (N, 3) mm, between the two.
        distances_mm: (N,) between the two.
        normals: (N, 3) unit vectors, the mean of both.
        apart_mm: (N,) how far the other scan's surface lies outside, along the normal.
        weights: (N,) one over the variance of that.
    """

    which: NDArray[np.intp]
    theirs: NDArray[np.intp]
    points: Points
    distances_mm: Floats
    normals: Points
    apart_mm: Floats
    weights: Floats

    @classmethod
    def between(
        cls, one: Sample, pose: RigidTransform, other: Searched, other_pose: RigidTransform, reach_mm: float
    ) -> Self:
        there = other_pose.inverse() @ pose
        points, normals = there @ one.points, one.normals @ there.rotation.T
        workers = -1 if len(points) > _MANY else 1
        distances, number = map(
            np.asarray, other.tree.query(points, distance_upper_bound=reach_mm, workers=workers)
        )
        which = np.flatnonzero(np.isfinite(distances))
        theirs = number[which]
        partner, facing = other.sample.points[theirs], other.sample.normals[theirs]
        is_alike = np.einsum("ni,ni->n", normals[which], facing) > _ALIKE
        which, theirs, partner, facing = (
            which[is_alike],
            theirs[is_alike],
            partner[is_alike],
            facing[is_alike],
        )
        # Along the mean of both normals, two points of one round surface are not apart at all.
        mean = normals[which] + facing
        mean /= np.linalg.norm(mean, axis=1, keepdims=True)
        apart = np.einsum("ni,ni->n", partner - points[which], mean)
        weights = 1.0 / (one.sigma_mm[which] ** 2 + other.sample.sigma_mm[theirs] ** 2)
        middle = other_pose @ (0.5 * (points[which] + partner))
        return cls(which, theirs, middle, distances[which], mean @ other_pose.rotation.T, apart, weights)

    def __len__(self) -> int:
        return len(self.which)

    def select(self, keep: NDArray[np.bool_]) -> "Partners":
        return Partners(
            self.which[keep], self.theirs[keep], self.points[keep], self.distances_mm[keep],
            self.normals[keep], self.apart_mm[keep], self.weights[keep],
        )  # fmt: skip


def refine(
    scans: Sequence[Searched],
    poses: Sequence[RigidTransform],
    links: Sequence[tuple[int, int]],
    reach_mm: float,
    iterations: int,
) -> list[RigidTransform]:
    """Poses at which surfaces lie on each other best; that of the first scan stays.

    Point to plane, both ways along each link, each pair counted by its variance and, beyond what is usual
    among all pairs, not at all.

    Args:
        poses: (K) of the scans in the common frame, to begin with.
        links: numbers of scans that lie on each other.
        reach_mm: how far apart partners may be.
        iterations: at most.
    """
    found = list(poses)
    if not links:
        return found
    middle = np.mean(
        [pose @ scan.sample.points.mean(axis=0) for scan, pose in zip(scans, poses, strict=True)], axis=0
    )
    reach = max(scan.sample.extent_mm() for scan in scans) / 2.0
    for _ in range(iterations):
        size = 6 * len(scans)
        normal_matrix, right = np.zeros((size, size)), np.zeros(size)
        for a, b in links:
            for one, other in ((a, b), (b, a)):
                pairs = Partners.between(scans[one].sample, found[one], scans[other], found[other], reach_mm)
                if len(pairs) < 6:
                    continue
                agreeing = tukey(pairs.apart_mm, _LEAST_LIMIT * reach_mm)
                weights = pairs.weights / pairs.weights.mean() * agreeing
                arms = (pairs.points - middle) / reach
                rows = np.hstack([np.cross(arms, pairs.normals), pairs.normals])
                block = (rows * weights[:, None]).T @ rows
                pull = rows.T @ (weights * pairs.apart_mm)
                i, j = slice(6 * one, 6 * one + 6), slice(6 * other, 6 * other + 6)
                normal_matrix[i, i] += block
                normal_matrix[j, j] += block
                normal_matrix[i, j] -= block
                normal_matrix[j, i] -= block
                right[i] += pull
                right[j] -= pull
        free = normal_matrix[6:, 6:]
        # What nothing holds, such as the turn of a ball, stays where it is.
        free = free + 1e-6 * max(np.trace(free) / len(free), 1e-12) * np.eye(len(free))
        steps = np.concatenate([np.zeros(6), np.linalg.solve(free, right[6:])]).reshape(-1, 2, 3)
        for number, (turn, shift) in enumerate(steps):
            if number:
                rotation = rotation_from_rvec(turn / reach)
                motion = RigidTransform(rotation, middle + shift - rotation @ middle)
                found[number] = motion @ found[number]
        if float(np.abs(steps).max()) < _STILL * reach_mm:
            break
    return found


def tukey(residuals: Floats, least_limit: float = 0.0) -> Floats:
    """(N,) weights 0..1: one for what agrees, none for what is far from usual and beyond that limit."""
    limit = max(_TUKEY * spread(residuals), least_limit, 1e-9)
    share = np.clip(residuals / limit, -1.0, 1.0)
    return (1.0 - share**2) ** 2


def spread(residuals: Floats) -> float:
    """Standard deviation of the bulk of residuals about zero."""
    return _MAD_TO_SIGMA * float(np.median(np.abs(residuals))) if len(residuals) else 0.0
