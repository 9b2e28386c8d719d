"""Stripe centre as the intensity-weighted mean of the pixels around the peak."""

from dataclasses import dataclass

import numpy as np

from app.vision.candidates import Measured, find_candidates, run_windows, stripes_of
from app.vision.kernels import kernels
from app.vision.stripe import STRIPE_DETECTORS, LaserStripe, LaserView

# Variance of a pixel's grey level that is assumed where the picture does not tell.
_GREY_VARIANCE = 4.0


@dataclass(frozen=True, slots=True)
class CentroidDetector:
    """Fast and simple; every pixel of the window adds its noise, so a wide window is unsteady.

    Attributes:
        min_strength: a peak is no stripe below this height, grey levels.
        window_sigmas: half the window, in stripe sigmas of the picture.
    """

    min_strength: float = 20.0
    window_sigmas: float = 3.0

    def detect(self, view: LaserView) -> LaserStripe:
        """The strongest peak of every line."""
        return self.detect_several(view, 1)[0]

    def detect_several(self, view: LaserView, count: int) -> list[LaserStripe]:
        """`count` stripes, in the order in which they lie across the lines."""
        peaks = find_candidates(view, self.min_strength, count, kernels())
        light, column, clipped = run_windows(peaks)
        half = light.shape[1] // 2
        reach = min(half, max(1, int(np.ceil(self.window_sigmas * peaks.sigma))))
        window = light[:, half - reach : half + reach + 1]
        offsets = np.arange(-reach, reach + 1)
        mass = np.maximum(window.sum(axis=1), 1.0)
        mean = window @ offsets / mass
        squares = (offsets - mean[:, None]) ** 2
        found = Measured(
            peaks.line, peaks.track, column + mean, peaks.height,
            _GREY_VARIANCE * squares.sum(axis=1) / mass**2,
            np.sqrt((window * squares).sum(axis=1) / mass), peaks.second, clipped,
        )  # fmt: skip
        return stripes_of(found, view.orientation, count, kernels())


STRIPE_DETECTORS.register("centroid", CentroidDetector)
