"""Loops over the colours of whole pictures."""

import numpy as np

from app.vision.kernels.jit import compiled


@compiled
def colour_excess(own, first, second, excess):
    """Half of how far one channel exceeds the mean of the two others, 128 for not at all; (H, W) each.

    Quarters are rounded to the nearest whole number, halves to the even one, and that without a branch.
    """
    for line in range(len(own)):
        a, b, c, out = own[line], first[line], second[line], excess[line]
        for i in range(len(a)):
            quarters = np.int16(512) + np.int16(2) * np.int16(a[i]) - np.int16(b[i]) - np.int16(c[i])
            is_odd = (quarters >> np.int16(2)) & np.int16(1)
            out[i] = np.uint8((quarters + np.int16(1) + is_odd) >> np.int16(2))
