"""Observations of single views, and how they are joined to the arrays of the adjustment."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.calibration.bundle import Corners, Stripes
from app.calibration.views import View
from app.geometry.arrays import Floats
from app.vision.stripe import LaserStripe

Indices = NDArray[np.intp]

CORNER_SIGMA_PX = 0.10
"""Assumed of a corner until the residuals tell."""
_STRIPE_SIGMA_FLOOR_PX = 0.02


@dataclass(frozen=True, eq=False, slots=True)
class CornerPart:
    """Corners of one body in one view; the attributes are those of `Corners`."""

    pixels: Floats
    on_body: Floats
    marker: Indices
    body: int
    angle: int
    view: int
    group: int


@dataclass(frozen=True, eq=False, slots=True)
class StripePart:
    """One stripe on one body in one view; the attributes are those of `Stripes`."""

    pixels: Floats
    sigma: Floats
    body: int
    angle: int
    laser: int
    across: int
    view: int
    group: int


def thinned(stripe: LaserStripe, most: int) -> tuple[Floats, Floats]:
    """Means of neighbouring points of one segment, so that a stripe has about `most` of them.

    Returns:
        (M, 2) pixels and (M,) sigma across the stripe.
    """
    together = max(1, -(-len(stripe) // most))
    bundle = np.concatenate([[0], np.cumsum((np.diff(stripe.segment) != 0) | (np.diff(stripe.line) > 2))])
    position = np.arange(len(stripe)) - np.searchsorted(bundle, bundle)
    key = bundle * (len(stripe) + 1) + position // together
    _, index, count = np.unique(key, return_inverse=True, return_counts=True)
    pixels = np.column_stack([np.bincount(index, stripe.pixels[:, k]) / count for k in (0, 1)])
    variance = np.bincount(index, stripe.variance) / count
    return pixels, np.sqrt(np.maximum(variance, _STRIPE_SIGMA_FLOOR_PX**2) / count)


def board_corners(view: View, number: int, body: int, angle: int) -> CornerPart:
    """All corners of the board in one view."""
    seen = view.board
    none = np.full(len(seen.ids), -1, np.intp)
    return CornerPart(seen.corners, seen.board_points, none, body, angle, number, 0)


def _each(parts: Sequence[CornerPart] | Sequence[StripePart], field: str) -> Indices:
    sizes = [len(part.pixels) for part in parts]
    return np.repeat(np.array([getattr(part, field) for part in parts], np.intp), sizes)


def joined_corners(parts: Sequence[CornerPart]) -> tuple[Corners, Indices]:
    """All parts, and the view (Nc,) that each corner belongs to."""
    pixels = np.concatenate([np.zeros((0, 2)), *(p.pixels for p in parts)])
    corners = Corners(
        pixels,
        _each(parts, "body"),
        _each(parts, "angle"),
        np.concatenate([np.zeros((0, 3)), *(p.on_body for p in parts)]),
        np.concatenate([np.zeros(0, np.intp), *(p.marker for p in parts)]),
        np.full(len(pixels), CORNER_SIGMA_PX),
        _each(parts, "group"),
    )
    return corners, _each(parts, "view")


def joined_stripes(parts: Sequence[StripePart]) -> tuple[Stripes, Indices]:
    """All parts, and the view (Ns,) that each point belongs to."""
    stripes = Stripes(
        np.concatenate([np.zeros((0, 2)), *(p.pixels for p in parts)]),
        _each(parts, "body"),
        _each(parts, "angle"),
        _each(parts, "laser"),
        _each(parts, "across"),
        np.concatenate([np.zeros(0), *(p.sigma for p in parts)]),
        _each(parts, "group"),
    )
    return stripes, _each(parts, "view")
