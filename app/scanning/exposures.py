"""One stripe from several exposures of the same view."""

from collections.abc import Sequence

import numpy as np

from app.vision.stripe import LaserStripe, Orientation

_JUMP_PX = 2.0


def combine_exposures(stripes: Sequence[LaserStripe], orientation: Orientation) -> LaserStripe:
    """For every line the longest exposure whose stripe is not clipped; the shortest where all are.

    Args:
        stripes: longest exposure first.
    """
    if len(stripes) == 1:
        return stripes[0]
    lines = np.unique(np.concatenate([stripe.line for stripe in stripes]))
    source = np.full(len(lines), -1)
    index = np.zeros(len(lines), np.intp)
    is_settled = np.zeros(len(lines), np.bool_)
    for number, stripe in enumerate(stripes):
        at = np.searchsorted(lines, stripe.line)
        better = ~is_settled[at]
        source[at[better]] = number
        index[at[better]] = np.flatnonzero(better)
        is_settled[at[better & ~stripe.saturated]] = True
    parts = [stripe.select(index[source == number]) for number, stripe in enumerate(stripes)]
    return renumbered(joined(parts), orientation)


def joined(stripes: Sequence[LaserStripe]) -> LaserStripe:
    """All points of several stripes in the order of their lines."""
    order = np.argsort(np.concatenate([stripe.line for stripe in stripes]), kind="stable")

    def field(name: str) -> np.ndarray:
        values: np.ndarray = np.concatenate([getattr(stripe, name) for stripe in stripes])[order]
        return values

    return LaserStripe(
        field("pixels"), field("line"), field("strength"), field("variance"), field("width"),
        field("second"), field("segment"), field("saturated"),
    )  # fmt: skip


def renumbered(stripe: LaserStripe, orientation: Orientation) -> LaserStripe:
    """The same points in unbroken pieces: a gap in the lines or a step across them begins a new one."""
    across = stripe.pixels[:, 0 if orientation == "vertical" else 1]
    gap = np.diff(stripe.line)
    breaks = (gap > 1) | (np.abs(np.diff(across)) > _JUMP_PX)
    segment = np.concatenate([np.zeros(min(1, len(stripe)), np.intp), np.cumsum(breaks).astype(np.intp)])
    return LaserStripe(
        stripe.pixels, stripe.line, stripe.strength, stripe.variance, stripe.width, stripe.second,
        segment, stripe.saturated,
    )  # fmt: skip
