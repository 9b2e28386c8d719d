"""Normals from the order in which points were measured: along the stripe, and across to its neighbours."""

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats
from app.scanning.profile import Slice

_HALF_WINDOW = 4
# Further apart than this many times the usual step between profiles, two points are no neighbours.
_LONGEST_STEP = 6.0
_WIDEST_TURN_RAD = 0.35
# The two tangents must open at least this far, as the sine of the angle between them.
_LEAST_OPENING = 0.1


def normals_of(before: Slice | None, here: Slice, after: Slice | None) -> NDArray[np.float32]:
    """Unit normals (N, 3) of a slice, turned towards the camera; zeros where they cannot be told.

    The tangent along the stripe is a straight line fitted to the points of the same piece within four lines;
    the one across is the step from the profile before to the one after, over the same window and along the
    same image lines. The normal is their cross product.

    Args:
        before, after: the neighbouring slices of the same laser, in the order they were taken; None at
            the ends.
    """
    n = len(here)
    normals = np.zeros((n, 3), np.float32)
    if n < 3:
        return normals
    first, last = _windows(here)
    along, spacing = _along(here, first, last)
    across = _across(before, here, after, spacing)
    step = _summed(across, first, last)
    normal = _cross(along, step)
    length = _lengths(normal)
    with np.errstate(invalid="ignore", divide="ignore"):
        opening = length / (_lengths(along) * _lengths(step))
        is_known = opening > _LEAST_OPENING
    is_towards = np.einsum("ij,ij->i", normal, here.camera - here.points) > 0.0
    scale = np.where(is_towards, 1.0, -1.0)[is_known] / length[is_known]
    normals[is_known] = normal[is_known] * scale[:, None]
    return normals


def _windows(here: Slice) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First and last + 1 index of every point's window, which ends where its piece of stripe ends."""
    n = len(here)
    breaks = (
        np.flatnonzero((np.diff(here.stripe.segment) != 0) | (np.diff(here.stripe.line) > _HALF_WINDOW)) + 1
    )
    edges = np.concatenate([[0], breaks, [n]])
    piece = np.repeat(np.arange(len(edges) - 1), np.diff(edges))
    at = np.arange(n)
    return np.maximum(at - _HALF_WINDOW, edges[piece]), np.minimum(at + _HALF_WINDOW + 1, edges[piece + 1])


def _along(here: Slice, first: NDArray[np.intp], last: NDArray[np.intp]) -> tuple[Floats, float]:
    """Slope (N, 3) of a line through each window, mm per image line, and the usual distance of neighbours."""
    origin = here.points[0].astype(np.float64)
    points = here.points - origin
    line = (here.stripe.line - here.stripe.line[0]).astype(np.float64)
    stacked = np.column_stack([np.ones_like(line), line, line**2, points, line[:, None] * points])
    window = _summed(stacked, first, last)
    count, mean = window[:, 0], window[:, 1] / window[:, 0]
    spread = window[:, 2] - count * mean**2
    with np.errstate(invalid="ignore", divide="ignore"):
        slope: Floats = (window[:, 6:9] - mean[:, None] * window[:, 3:6]) / spread[:, None]
    slope[(count < 3) | (spread <= 0.0)] = np.nan
    lengths = _lengths(slope)
    known = lengths[np.isfinite(lengths)]
    return slope, float(np.median(known)) if len(known) else 0.0


def _across(before: Slice | None, here: Slice, after: Slice | None, spacing: float) -> Floats:
    """Step (N, 3) from the profile before to the one after on the same line; zero where there is none."""
    radius = np.hypot(here.points[:, 0], here.points[:, 1])
    total = np.zeros((len(here), 3))
    for other, sign in ((before, -1.0), (after, 1.0)):
        if other is None or not len(other):
            continue
        turn = abs(float(np.angle(np.exp(1j * (other.angle_rad - here.angle_rad)))))
        if turn > _WIDEST_TURN_RAD:
            continue
        at = np.minimum(np.searchsorted(other.stripe.line, here.stripe.line), len(other) - 1)
        step = sign * (other.points[at] - here.points).astype(np.float64)
        limit = _LONGEST_STEP * (turn * radius + spacing)
        is_near = (other.stripe.line[at] == here.stripe.line) & (_lengths(step) <= limit)
        total += step * is_near[:, None]
    return total


def _summed(values: Floats, first: NDArray[np.intp], last: NDArray[np.intp]) -> Floats:
    """Sums of rows `first` to `last` - 1 of values (N, K), for every window."""
    sums = np.zeros((len(values) + 1, values.shape[1]))
    np.cumsum(values, axis=0, out=sums[1:])
    return sums[last] - sums[first]


def _lengths(vectors: Floats) -> Floats:
    lengths: Floats = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
    return lengths


def _cross(a: Floats, b: Floats) -> Floats:
    """As `np.cross` of (N, 3), which takes several times as long."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.column_stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
