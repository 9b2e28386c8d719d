"""The surroundings of each peak, in NumPy."""

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats
from app.vision.kernels.results import CLIPPED_FROM, Windows
from app.vision.stripe import Image


def cut_windows_between(
    lit: Image,
    dark: Image,
    channel: int,
    line: NDArray[np.intp],
    column: NDArray[np.intp],
    half: int,
    core: int,
    albedo_noise: float,
) -> Windows:
    """Windows of lit minus dark, evened out where the surface itself changes its brightness.

    Args:
        lit, dark: (H, W, 3) or (H, W).
        channel: which channel of a colour picture.
        line, column: (N,) middle of each window.
        half: pixels to either side.
        core: clipped pixels are counted this far from the middle.
        albedo_noise: variance of a dark pixel beyond its shot noise; 0 leaves the albedo alone.
    """
    on, inside = _cut(lit, channel, line, column, half)
    off, _ = _cut(dark, channel, line, column, half)
    is_clipped = on >= CLIPPED_FROM
    signal = np.where(inside, on - off, 0.0)
    count = np.maximum(inside.sum(axis=1), 1)
    level = np.where(inside, off, 0.0).sum(axis=1) / count
    clipped = is_clipped[:, half - core : half + core + 1].sum(axis=1)
    if albedo_noise > 0.0:
        spread = np.where(inside, (off - level[:, None]) ** 2, 0.0).sum(axis=1) / count
        darkest = np.where(inside, off, np.inf).min(axis=1)
        evens = (darkest >= 25.0) & (spread > 0.01 * level * level) & (clipped == 0)
        evens &= spread > 16.0 * (albedo_noise + 0.03 * level)
        share = np.where(evens[:, None] & inside, level[:, None] / np.maximum(off, 1.0), 1.0)
        signal = signal * share
    return Windows(signal, inside & ~is_clipped, clipped, 2.0 * level, np.zeros(len(line)))


def cut_windows(
    lit: Image,
    light: Image,
    channel: int,
    line: NDArray[np.intp],
    column: NDArray[np.intp],
    half: int,
    core: int,
    foot: int,
) -> Windows:
    """Windows of one picture, of what rises above its surroundings.

    What lies just beyond the core on both sides is no stripe, and is taken off. The background's own edges
    are what `light` is free of; how high they are is told.

    Args:
        lit: (H, W, 3) or (H, W).
        light: (H, W) brightness above the surroundings.
        channel: which channel of a colour picture.
        line, column: (N,) middle of each window.
        half: pixels to either side.
        core: the stripe reaches this far from the middle; there the background's edges are measured.
        foot: pixels beyond it that show the background; half is at least core + foot.
    """
    on, inside = _cut(lit, channel, line, column, half)
    risen, _ = _cut(light, 0, line, column, half)
    is_clipped = on >= CLIPPED_FROM
    feet = slice(half - core - foot, half - core), slice(half + core + 1, half + core + 1 + foot)
    rims = slice(half - core - 1, half - core + 2), slice(half + core - 1, half + core + 2)
    before, after = (_mean_inside(on[:, part], inside[:, part]) for part in rims)
    low = np.fmin(*(_mean_inside(risen[:, part], inside[:, part]) for part in feet))
    before, after = np.where(np.isnan(before), after, before), np.where(np.isnan(after), before, after)
    before, after, low = np.nan_to_num(before), np.nan_to_num(after), np.nan_to_num(low)
    signal = np.where(inside, risen - low[:, None], 0.0)
    clipped = is_clipped[:, half - core : half + core + 1].sum(axis=1)
    return Windows(signal, inside & ~is_clipped, clipped, 0.5 * (before + after), np.abs(after - before))


def _mean_inside(values: Floats, inside: NDArray[np.bool_]) -> Floats:
    """Mean (N,) of each row's values inside the picture; NaN where there are none."""
    many = inside.sum(axis=1)
    total = np.where(inside, values, 0.0).sum(axis=1)
    return np.where(many > 0, total / np.maximum(many, 1), np.nan)


def _cut(
    image: Image, channel: int, line: NDArray[np.intp], column: NDArray[np.intp], half: int
) -> tuple[Floats, NDArray[np.bool_]]:
    across = column[:, None] + np.arange(-half, half + 1)
    inside = (across >= 0) & (across < image.shape[1])
    plane = image if image.ndim == 2 else image[:, :, channel]
    values = plane[line[:, None], np.clip(across, 0, image.shape[1] - 1)].astype(np.float64)
    return np.where(inside, values, 0.0), inside
