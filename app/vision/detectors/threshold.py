"""The paper's detector: threshold the laser light and take the lit pixels."""

from dataclasses import dataclass

import numpy as np

from app.vision.candidates import Measured, find_candidates, run_windows, stripes_of
from app.vision.kernels import kernels
from app.vision.stripe import STRIPE_DETECTORS, LaserStripe, LaserView


@dataclass(frozen=True, slots=True)
class ThresholdDetector:
    """Middle of the lit pixels of each line, whole and half pixels.

    The paper makes a point of every lit pixel. Their mean on a line is the same stripe with one point per
    line, as the other detectors have it; lit pixels apart from the run that holds the brightest one are left
    out.

    Attributes:
        min_strength: a pixel with less laser light is dark, grey levels.
    """

    min_strength: float = 30.0

    def detect(self, view: LaserView) -> LaserStripe:
        """The brightest lit run of every line."""
        return self.detect_several(view, 1)[0]

    def detect_several(self, view: LaserView, count: int) -> list[LaserStripe]:
        """`count` stripes, in the order in which they lie across the lines."""
        peaks = find_candidates(view, self.min_strength, count, kernels())
        light, column, clipped = run_windows(peaks)
        # From the summit outwards up to the first dark pixel: laser_mask, one run of it.
        is_lit = light > self.min_strength
        half = light.shape[1] // 2
        to_left = np.cumprod(is_lit[:, half::-1], axis=1).sum(axis=1) - 1
        to_right = np.cumprod(is_lit[:, half:], axis=1).sum(axis=1) - 1
        pixels = to_left + to_right + 1
        which = np.flatnonzero(pixels > 0)
        across = column + 0.5 * (to_right - to_left)
        found = Measured(
            peaks.line[which], peaks.track[which], across[which], peaks.height[which],
            # Either end of the run is known to a pixel, evenly.
            np.full(len(which), 2.0 / 12.0 / 4.0),
            # Sigma of the even distribution over the run.
            (pixels / np.sqrt(12.0))[which], peaks.second[which], clipped[which],
        )  # fmt: skip
        return stripes_of(found, view.orientation, count, kernels())


STRIPE_DETECTORS.register("threshold", ThresholdDetector)
