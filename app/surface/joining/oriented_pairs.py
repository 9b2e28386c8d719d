"""Guesses how two scans lie to each other: from pairs of points that look the same in both."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats, Points
from app.surface.joining.sample import Sample

# Points of each scan that are paired with each other.
_POINTS = 700
_DISTANCE_BINS = 20
_ANGLE_BINS = 14
# Shares of the thing's extent: short pairs tell little of the direction, long ones are in one scan alone.
_SHORTEST, _LONGEST = 0.15, 0.8
_MOST_ALONG = 0.97


def guesses(
    fixed: Sample, moving: Sample, extent_mm: float, count: int, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Rotations (H, 3, 3) and translations (H, 3) that lay the moving scan on the fixed one; most are wrong.

    Two points and their normals are known, up to a rigid motion, by four numbers: the distance, the angles of
    both normals to the line between, and the turn from one to the other about it, which also tells a thing
    from its mirror image. Pairs with the same four numbers in both scans give one guess each. Rare numbers
    are taken as often as common ones: a handle tells more than a wall.
    """
    one, other = (_Pairs.among(sample, extent_mm, rng) for sample in (fixed, moving))
    order = np.argsort(one.keys, kind="stable")
    ordered = one.keys[order]
    first = np.searchsorted(ordered, other.keys, "left")
    matches = np.searchsorted(ordered, other.keys, "right") - first
    candidates = np.flatnonzero(matches)
    if not len(candidates):
        return np.zeros((0, 3, 3)), np.zeros((0, 3))
    own = np.bincount(other.keys)[other.keys[candidates]]
    weights = 1.0 / (own * np.sqrt(matches[candidates]))
    picked = rng.choice(candidates, count, p=weights / weights.sum())
    partner = order[first[picked] + (rng.random(count) * matches[picked]).astype(np.intp)]
    fixed_frames, fixed_middles = one.frames(partner)
    moving_frames, moving_middles = other.frames(picked)
    rotations: Floats = fixed_frames @ np.swapaxes(moving_frames, 1, 2)
    return rotations, fixed_middles - np.einsum("hij,hj->hi", rotations, moving_middles)


@dataclass(frozen=True, eq=False, slots=True)
class _Pairs:
    """Ordered pairs of points: (N,) numbers of their points, and (N,) one number for the shape of each."""

    sample: Sample
    start: NDArray[np.intp]
    end: NDArray[np.intp]
    keys: NDArray[np.int64]

    @classmethod
    def among(cls, sample: Sample, extent_mm: float, rng: np.random.Generator) -> Self:
        chosen = rng.permutation(len(sample))[:_POINTS]
        start, end = (each.ravel() for each in np.meshgrid(chosen, chosen, indexing="ij"))
        points, normals = sample.points.astype(np.float32), sample.normals.astype(np.float32)
        line = points[end] - points[start]
        distance = np.linalg.norm(line, axis=1)
        is_good = (distance > _SHORTEST * extent_mm) & (distance < _LONGEST * extent_mm)
        start, end, distance = start[is_good], end[is_good], distance[is_good]
        line = line[is_good] / distance[:, None]
        at, to = normals[start], normals[end]
        leans, leans_there = np.einsum("ni,ni->n", at, line), np.einsum("ni,ni->n", to, line)
        # About the line, from one normal to the other.
        sine = np.einsum("ni,ni->n", line, np.cross(at, to))
        cosine = np.einsum("ni,ni->n", at, to) - leans * leans_there
        turn = np.arctan2(sine, cosine)
        keys = (distance / extent_mm * _DISTANCE_BINS).astype(np.int64)
        for angle, bins in (
            (np.arccos(np.clip(leans, -1.0, 1.0)) / np.pi, _ANGLE_BINS),
            (np.arccos(np.clip(leans_there, -1.0, 1.0)) / np.pi, _ANGLE_BINS),
            ((turn / np.pi + 1.0) / 2.0, 2 * _ANGLE_BINS),
        ):
            keys = keys * bins + np.minimum((angle * bins).astype(np.int64), bins - 1)
        is_told = (np.abs(leans) < _MOST_ALONG) & (np.abs(leans_there) < _MOST_ALONG)
        return cls(sample, start[is_told], end[is_told], keys[is_told])

    def frames(self, which: NDArray[np.intp]) -> tuple[Floats, Points]:
        """(H, 3, 3) axes as columns, along the line and in the first normal's plane; (H, 3) middles."""
        begin, end = self.sample.points[self.start[which]], self.sample.points[self.end[which]]
        normal = self.sample.normals[self.start[which]]
        x = (end - begin) / np.linalg.norm(end - begin, axis=1, keepdims=True)
        y = normal - np.einsum("hi,hi->h", normal, x)[:, None] * x
        y /= np.linalg.norm(y, axis=1, keepdims=True)
        return np.stack([x, y, np.cross(x, y)], axis=2), (begin + end) / 2.0
