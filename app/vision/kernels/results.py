"""What a kernel hands back; the compiled kernels and their NumPy twin share it."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats

CLIPPED_FROM = 250
"""A pixel this bright tells only that it was brighter."""
REACH = 48
"""How far from its summit a peak is followed, px."""
BLOCK = 64
TEXTURE_STEP = 4
"""The picture's texture is looked at in pieces of a line this long, on every so many lines."""
FARTHEST = 0.9
"""Scoring that moves a point further than this many sigmas has gone astray."""
CLASSES = 12
"""Of brightness, evenly in its root, up to the brightest stripe of the picture."""
LEAST_FREE = 0.2
"""A pixel keeps at least this share of its residual's variance when the fit has taken its part."""
SUMMIT_REACH = 3
"""The brightest pixel lies this near to the one that looks most like laser, px."""
HIGH, LOW = 0.65, 0.3
"""Shares of a peak's height at which its width is taken."""
SCORING_ROUNDS = 2
SCORING_REACH = 3.5
"""Pixels this many sigmas around the stripe tell its amplitude, and take part in the scoring."""


class Peaks(NamedTuple):
    """The strongest peaks of every line, strongest first.

    Attributes:
        height: (L, C + 1) grey levels; 0 where the line has no such peak. The last one only tells how strong
            a rival the peaks before it have.
        centre: (L, C) middle between the two places where the peak has fallen to half its height.
        sigma: (L, C) the peak's sigma as its two flanks tell it; NaN where there is no peak.
        texture: what noise and pattern reach in a quiet piece of a line without any stripe, grey levels.
    """

    height: Floats
    centre: Floats
    sigma: Floats
    texture: float


class Windows(NamedTuple):
    """The surroundings of N peaks, background taken off.

    Attributes:
        signal: (N, W) grey levels above the background; 0 outside the picture.
        usable: (N, W) whether a pixel tells its value: inside the picture and not clipped.
        clipped: (N,) how many pixels near the summit are clipped.
        floor: (N,) what adds to the noise of every pixel whatever the stripe: grey levels of background
            light that were seen, summed over the pictures it was seen in.
        asymmetry: (N,) how much the background differs between the two sides, grey levels.
    """

    signal: Floats
    usable: NDArray[np.bool_]
    clipped: NDArray[np.intp]
    floor: Floats
    asymmetry: Floats

    def select(self, which: NDArray[np.intp]) -> "Windows":
        return Windows(
            self.signal.take(which, axis=0), self.usable.take(which, axis=0), self.clipped.take(which),
            self.floor.take(which), self.asymmetry.take(which),
        )  # fmt: skip


class Refined(NamedTuple):
    """N stripe centres.

    Attributes:
        offset: (N,) position relative to the middle of the window, px.
        amplitude: (N,) height of the stripe, grey levels.
        width: (N,) sigma of the stripe, px.
        variance: (N,) of the offset, px^2.
        is_found: (N,) whether the line has a stripe; the other values of a line without one are 0.
    """

    offset: Floats
    amplitude: Floats
    width: Floats
    variance: Floats
    is_found: NDArray[np.bool_]


class Leftovers(NamedTuple):
    """What a fit leaves over, by classes of brightness.

    Attributes:
        terms: (CLASSES, 3) mean of m^2, mean of m, and 1, m being the stripe's light in a pixel; zeros for an
            empty class.
        squares: (CLASSES,) mean squared residual, what the fit has taken up given back.
        pixels: how many.
        sigma_step: by what share of itself the sigma should change.
    """

    terms: Floats
    squares: Floats
    pixels: int
    sigma_step: float


class Shape(NamedTuple):
    """How a stripe is expected to look, and how noisy the camera is.

    Attributes:
        sigma: of the stripe, px.
        filter_sigma: of the kernel whose zero crossing is sought, px.
        contrast: of the speckle, standard deviation over mean.
        gain: electrons per grey level.
        read_variance: of one pixel in the dark, grey levels squared.
    """

    sigma: float
    filter_sigma: float
    contrast: float
    gain: float
    read_variance: float

    @property
    def filter_radius(self) -> int:
        """Beyond it the kernel has nothing left to say."""
        return math.ceil(3.0 * self.filter_sigma)

    @property
    def search_radius(self) -> int:
        """How far the zero crossing may lie from the middle of the window."""
        return math.ceil(1.2 * self.filter_sigma) + 2

    @property
    def half_window(self) -> int:
        return self.filter_radius + self.search_radius
