"""The stripe as unbroken pieces: what belongs together, how rough it is, and smoothing inside a piece."""

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats

LARGEST_STEP_PX = 2.0
"""A larger step between neighbouring lines is an edge in depth."""
LONG_PIECE = 20
"""Lines."""
LEAST_BENDS = 30
"""Fewer inner points do not tell how rough a stripe is."""
_MAD_TO_SIGMA = 1.4826


def segments_of(
    line: NDArray[np.intp], across: Floats, largest_step_px: float = LARGEST_STEP_PX
) -> NDArray[np.intp]:
    """Number of the unbroken piece (N,) every point belongs to.

    A piece ends where a line is missing and where the position steps away from the stripe's own slope.

    Args:
        line: (N,) growing, stripe after stripe.
        across: (N,) position on the line, px.
        largest_step_px: a larger step between neighbouring lines is an edge in depth.
    """
    if len(line) == 0:
        return np.zeros(0, np.intp)
    step = np.diff(across)
    breaks = np.diff(line) != 1
    steep = np.abs(step) > largest_step_px
    if steep.any():
        breaks |= steep & (np.abs(step - _running_median(step)) > largest_step_px)
    return np.concatenate([[0], np.cumsum(breaks)]).astype(np.intp)


def _running_median(values: Floats, reach: int = 3) -> Floats:
    padded = np.pad(values, reach, mode="edge")
    median: Floats = np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1), axis=1)
    return median


def in_long_pieces(line: NDArray[np.intp], across: Floats, least: int = LONG_PIECE) -> NDArray[np.bool_]:
    """Whether (N,) a point belongs to an unbroken piece of so many lines, as clutter rarely does.

    Args:
        line: (N,) growing, stripe after stripe.
        across: (N,) position on the line, px.
        least: lines.
    """
    segment = segments_of(line, across)
    is_long: NDArray[np.bool_] = np.bincount(segment)[segment] >= least
    return is_long


def has_company(line: NDArray[np.intp], across: Floats) -> NDArray[np.bool_]:
    """Whether (N,) a point has at least two others within three lines that could be the same stripe.

    Args:
        line: (N,) growing.
        across: (N,) position on the line, px.
    """
    company = np.zeros(len(line), np.intp)
    for hop in range(1, 4):
        if len(line) <= hop or company.min() >= 2:
            break
        lines = line[hop:] - line[:-hop]
        near = (lines <= 3) & (np.abs(across[hop:] - across[:-hop]) <= 1.0 + 3.0 * lines)
        company[hop:] += near
        company[:-hop] += near
    return company >= 2


def roughness(across: Floats, segment: NDArray[np.intp]) -> Floats:
    """How far (M,) each inner point lies off the middle of its two neighbours, doubled, px.

    Only noise is left of a smooth surface: the standard deviation is sqrt(6) times that of a point.
    """
    inner = segment[2:] == segment[:-2]
    second = across[2:] - 2.0 * across[1:-1] + across[:-2]
    at_inner: Floats = second[inner]
    return at_inner


def noise_scale(across: Floats, variance: Floats, segment: NDArray[np.intp]) -> float:
    """By what the variances must be multiplied to agree with the stripe's roughness.

    One where there are too few points to tell; limited to 1/2 .. 25, since a picture may have been smoothed
    along the stripe, and a surface may be rough.
    """
    second = roughness(across, segment)
    if len(second) < LEAST_BENDS:
        return 1.0
    inner = segment[2:] == segment[:-2]
    expected = (variance[2:] + 4.0 * variance[1:-1] + variance[:-2])[inner]
    sigmas = _MAD_TO_SIGMA * float(np.median(np.abs(second) / np.sqrt(expected)))
    return float(np.clip(sigmas * sigmas, 0.5, 25.0))


def smooth_within(
    line: NDArray[np.intp], across: Floats, variance: Floats, segment: NDArray[np.intp], rows: int
) -> tuple[Floats, Floats]:
    """Positions and variances (N,) after a weighted straight-line fit to `rows` neighbours of one piece.

    Away from the ends that is the weighted mean; near an end the slope keeps the point from lagging.
    Variances of neighbours are no longer independent afterwards.
    """
    if rows < 2 or len(line) < 2:
        return across, variance
    n = len(line)
    index = np.arange(n)
    starts = np.flatnonzero(np.diff(segment, prepend=segment[0] - 1))
    ends = np.append(starts[1:], n)
    piece = np.searchsorted(starts, index, side="right") - 1
    half = rows // 2
    first = np.maximum(index - half, starts[piece])
    last = np.minimum(index + half + 1, ends[piece])
    weight = 1.0 / variance
    x = line.astype(np.float64) - float(line.mean())
    u = across - float(across.mean())

    def windowed(values: Floats) -> Floats:
        total = np.concatenate([[0.0], np.cumsum(values)])
        part: Floats = total[last] - total[first]
        return part

    s0 = windowed(weight)
    s1 = windowed(weight * x) - x * s0
    s2 = windowed(weight * x * x) - x * (2.0 * s1 + x * s0)
    t0 = windowed(weight * u)
    t1 = windowed(weight * u * x) - x * t0
    determinant = s0 * s2 - s1 * s1
    fits = (last - first >= 3) & (determinant > 1e-9 * s0 * s2)
    safe = np.where(fits, determinant, 1.0)
    smooth = np.where(fits, (s2 * t0 - s1 * t1) / safe + float(across.mean()), across)
    return smooth, np.where(fits, s2 / safe, variance)
