"""Loops over the colours of whole pictures."""

import numpy as np

from app.vision.stripe import Image


def colour_excess(own: Image, first: Image, second: Image) -> Image:
    """How far a pixel turns towards one colour.

    Args:
        own: (H, W) the channel of that colour.
        first, second: (H, W) the two others.

    Returns:
        (H, W) half of what `own` exceeds their mean by, and 128 for nothing; rounded, halves to even.
    """
    excess = 128.0 + 0.5 * own - 0.25 * first - 0.25 * second
    rounded: Image = np.rint(excess).astype(np.uint8)
    return rounded
