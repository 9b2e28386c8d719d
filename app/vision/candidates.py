"""Peaks that may be the stripe: how detectors look for them, and what becomes of them."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats
from app.vision.kernels import Kernels, twin
from app.vision.stripe import Image, LaserStripe, LaserView, Orientation
from app.vision.threshold import across_lines, laser_channel, ridge_response

# The highest of 64 pixels of noise lies 2.2 standard deviations up or more in three of four cases; that of
# a whole picture 5.
_TEXTURES = 2.3
_LARGEST_SIGMA_PX = 10.0


@dataclass(frozen=True, eq=False, slots=True)
class Candidates:
    """Peaks of one picture, stripe after stripe, each in the order of the lines.

    Attributes:
        lit, dark: the pictures, rows across the stripe.
        light: (L, W) how far each pixel rises above its surroundings; unused with a dark partner.
        channel: of a colour picture, the one that sees the laser.
        line: (N,) row number.
        track: (N,) which of the stripes it belongs to, in the order in which they lie across.
        centre: (N,) middle of the peak at half height, px.
        height: (N,) above the surroundings, grey levels.
        second: (N,) height of the line's next peak as a share of this one, 0..1.
        sigmas: (N,) of each, roughly, px.
    """

    lit: Image
    dark: Image | None
    light: Image
    channel: int
    line: NDArray[np.intp]
    track: NDArray[np.intp]
    centre: Floats
    height: Floats
    second: Floats
    sigmas: Floats

    @property
    def sigma(self) -> float:
        """Of a typical peak, px: the brighter half knows it best."""
        if len(self.line) == 0:
            return 1.0
        bright = self.sigmas[self.height >= _median(self.height)]
        return min(max(_median(bright), 0.5), _LARGEST_SIGMA_PX)


def find_candidates(view: LaserView, min_strength: float, count: int, kernels: Kernels) -> Candidates:
    """The `count` strongest peaks of every line that stand out of the picture's noise."""
    lit, dark = across_lines(view)
    channel = laser_channel(lit, dark, view.colour)
    least = min(max(math.ceil(min_strength), 1), 255)
    light = lit
    if dark is None:
        response, light = ridge_response(lit, channel, view.colour, kernels)
        peaks = kernels.find_peaks(response, light, least, count)
    else:
        peaks = kernels.find_peaks_between(lit, dark, channel, least, count)
    limit = max(least, _TEXTURES * peaks.texture)
    if count == 1:
        line = np.flatnonzero(peaks.height[:, 0] >= limit)
        at, track = 2 * line, np.zeros(len(line), np.intp)
        of_line = line
    else:
        line, rank = np.divmod(np.flatnonzero(peaks.height[:, :count] >= limit), count)
        track = _tracks(line, peaks.centre[line, rank], count)
        order = np.argsort(track, kind="stable")
        line, rank, track = line[order], rank[order], track[order]
        at, of_line = (count + 1) * line + rank, count * line + rank
    height = peaks.height.take(at)
    second = np.minimum(peaks.height[:, count].take(line) / height, 1.0)
    centre, sigmas = peaks.centre.take(of_line), peaks.sigma.take(of_line)
    return Candidates(lit, dark, light, channel, line, track, centre, height, second, sigmas)


def _median(values: Floats) -> float:
    """That of NumPy costs more by what it asks first than by the search."""
    middle = len(values) // 2
    if len(values) % 2:
        return float(np.partition(values, middle)[middle])
    around = np.partition(values, (middle - 1, middle))
    return 0.5 * float(around[middle - 1] + around[middle])


def run_windows(peaks: Candidates) -> tuple[Floats, NDArray[np.intp], NDArray[np.bool_]]:
    """Laser light around every candidate, for detectors that need no more.

    Returns:
        light (N, W), grey levels, never below 0; the column (N,) of the windows' middle; whether (N,) any
        pixel near it is clipped.
    """
    column = np.rint(peaks.centre).astype(np.intp)
    sigma = peaks.sigma
    half, core = int(np.ceil(5.0 * sigma)) + 2, int(np.ceil(3.0 * sigma))
    if peaks.dark is None:
        windows = twin.cut_windows(peaks.lit, peaks.light, peaks.channel, peaks.line, column, half, core, 2)
    else:
        windows = twin.cut_windows_between(
            peaks.lit, peaks.dark, peaks.channel, peaks.line, column, half, core, 0.0
        )
    light: Floats = np.maximum(windows.signal, 0.0)
    return light, column, windows.clipped > 0


@dataclass(frozen=True, eq=False, slots=True)
class Measured:
    """Sub-pixel peaks, one entry for each candidate that is kept.

    Attributes:
        line, strength, variance, width, second, saturated: as in `LaserStripe`.
        track: as in `Candidates`.
        across: position on the line, px.
    """

    line: NDArray[np.intp]
    track: NDArray[np.intp]
    across: Floats
    strength: Floats
    variance: Floats
    width: Floats
    second: Floats
    saturated: NDArray[np.bool_]

    def where(self, keep: NDArray[np.bool_]) -> "Measured":
        """The peaks of a mask, which most often is all of them."""
        if keep.all():
            return self
        return Measured(
            self.line[keep], self.track[keep], self.across[keep], self.strength[keep], self.variance[keep],
            self.width[keep], self.second[keep], self.saturated[keep],
        )  # fmt: skip


def stripes_of(
    found: Measured,
    orientation: Orientation,
    count: int,
    kernels: Kernels,
    smooth_rows: int = 0,
    measures_noise: bool = True,
) -> list[LaserStripe]:
    """Peaks made into `count` stripes, in the order in which they lie across the lines.

    Peaks without neighbours along the stripe are left out.
    """
    stripes = []
    for number in range(count):
        own = found if count == 1 else found.where(found.track == number)
        stripes.append(_stripe(own, orientation, kernels, smooth_rows, measures_noise))
    return stripes


def _stripe(
    found: Measured, orientation: Orientation, kernels: Kernels, smooth_rows: int, measures_noise: bool
) -> LaserStripe:
    found = found.where(kernels.has_company(found.line, found.across))
    line = found.line
    across, variance, segment = kernels.along_pieces(
        line, found.across, found.variance, smooth_rows, measures_noise
    )
    pixels = np.empty((len(line), 2))
    pixels[:, 0], pixels[:, 1] = (across, line) if orientation == "vertical" else (line, across)
    return LaserStripe(
        pixels, line, found.strength, variance, found.width, found.second, segment, found.saturated
    )


def _tracks(line: NDArray[np.intp], across: Floats, count: int) -> NDArray[np.intp]:
    """Which of the stripes (N,) each peak belongs to, numbered across the lines.

    Where a line has fewer peaks than there are stripes, each goes to the stripe that is nearest on the
    nearest complete line.
    """
    track = np.zeros(len(line), np.intp)
    if count == 1 or len(line) == 0:
        return track
    order = np.lexsort((across, line))
    lines, starts, many = np.unique(line[order], return_index=True, return_counts=True)
    complete = np.flatnonzero(many == count)
    rank = np.arange(len(line)) - np.repeat(starts, many)
    if len(complete) == 0:
        track[order] = rank
        return track
    places = across[order][starts[complete][:, None] + np.arange(count)]
    for index in np.flatnonzero(many != count):
        after = int(np.searchsorted(complete, index))
        near = [k for k in (after - 1, after) if 0 <= k < len(complete)]
        nearest = min(near, key=lambda k: abs(int(lines[complete[k]]) - int(lines[index])))
        own = slice(starts[index], starts[index] + many[index])
        gaps = np.abs(across[order][own][:, None] - places[nearest])
        rank[own] = _distinct(gaps)
    track[order] = rank
    return track


def _distinct(gaps: Floats) -> NDArray[np.intp]:
    """Nearest stripe of each peak, no two alike; gaps (peaks, stripes) with fewer peaks than stripes."""
    left = gaps.copy()
    chosen = np.zeros(len(gaps), np.intp)
    for _ in range(len(gaps)):
        peak, stripe = np.unravel_index(int(np.argmin(left)), left.shape)
        chosen[peak] = stripe
        left[peak, :] = np.inf
        left[:, stripe] = np.inf
    return chosen
