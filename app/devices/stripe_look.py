"""How a laser's stripe came out in a picture: clipped, strong, or hardly there."""

from dataclasses import dataclass

import numpy as np

from app.vision.stripe import STRIPE_DETECTORS, Image, LaserView
from app.vision.threshold import across_lines, laser_channel

MOST_CLIPPED = 0.02
_CLIPPED_GREY = 250.0
# A stripe of less height, or of less than so many times the noise, is found badly.
_LEAST_GREY = 25.0
_LEAST_NOISES = 8.0
_LEAST_LINES = 20
# The share of rows that may be clipped sets which row decides how bright the stripe is.
_BRIGHT_QUANTILE = 100.0 * (1.0 - MOST_CLIPPED)


@dataclass(frozen=True, slots=True)
class StripeLook:
    """How the stripe came out in one picture.

    Attributes:
        value: of the control, as the camera has it.
        lines: on how many lines the stripe was found.
        clipped: share of them whose core is clipped, 0..1.
        bright_grey: level that all but the brightest lines stay below.
        strength_grey: median height of the stripe above its surroundings.
        noise_grey: standard deviation of the difference of two pictures where there is no stripe.
    """

    value: float
    lines: int
    clipped: float
    bright_grey: float
    strength_grey: float
    noise_grey: float

    @property
    def is_clipped(self) -> bool:
        return self.clipped >= MOST_CLIPPED

    @property
    def is_seen(self) -> bool:
        return self.lines >= _LEAST_LINES

    @property
    def is_strong(self) -> bool:
        """Well above the noise."""
        return self.is_seen and self.strength_grey >= max(_LEAST_GREY, _LEAST_NOISES * self.noise_grey)


def look_at_stripe(view: LaserView, detector: str, value: float) -> StripeLook:
    """Judge one pair of pictures, lit and dark.

    Args:
        view: with a dark partner, because a stripe is judged by what it adds.
        detector: name of a stripe detector.
        value: of the control that the pictures were taken with.
    """
    stripe = STRIPE_DETECTORS.make(detector).detect(view)
    lit, dark = across_lines(view)
    channel = laser_channel(lit, dark, view.colour)
    plane = _plane(lit, channel)
    gain = plane.astype(np.int16) - _plane(lit if dark is None else dark, channel)
    # Half of all differences are within 0.674 standard deviations, and the stripe fills little of the lines.
    noise_grey = 1.4826 * float(np.median(np.abs(gain)))
    highest = gain.max(axis=1, keepdims=True)
    peaks = np.where(gain >= 0.5 * highest, plane, 0).max(axis=1)
    is_lit = highest[:, 0] >= _LEAST_GREY
    if len(stripe) < _LEAST_LINES:
        # A stripe that has bled into a broad band is none to the detector.
        bled = is_lit & (peaks >= _CLIPPED_GREY)
        share = float(bled.sum() / is_lit.sum()) if is_lit.sum() >= _LEAST_LINES else 0.0
        return StripeLook(value, int(bled.sum()), share, float(peaks.max()), 0.0, noise_grey)
    of_stripe = peaks[stripe.line]
    return StripeLook(
        value, len(stripe), float(np.mean(stripe.saturated | (of_stripe >= _CLIPPED_GREY))),
        float(np.percentile(of_stripe, _BRIGHT_QUANTILE)), float(np.median(stripe.strength)), noise_grey,
    )  # fmt: skip


def _plane(image: Image, channel: int) -> Image:
    return image if image.ndim == 2 else image[:, :, channel]
