"""What runs along the stripe, in NumPy; `segments` has the steps."""

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats
from app.vision.segments import (
    has_company,
    in_long_pieces,
    noise_scale,
    roughness,
    segments_of,
    smooth_within,
)

__all__ = ["along_pieces", "has_company", "in_long_pieces", "median_bend"]


def median_bend(line: NDArray[np.intp], across: Floats) -> float:
    """Median roughness of a stripe (N,), px; 0 where no point has two neighbours in its piece."""
    bends = roughness(across, segments_of(line, across))
    return float(np.median(np.abs(bends))) if len(bends) else 0.0


def along_pieces(
    line: NDArray[np.intp], across: Floats, variance: Floats, rows: int, measures_noise: bool
) -> tuple[Floats, Floats, NDArray[np.intp]]:
    """Positions and variances (N,) in the light of their neighbours, and the numbers of the pieces.

    Args:
        line: (N,) growing.
        across, variance: (N,) as measured, px and px^2.
        rows: how many neighbours are averaged; less than 2 for none.
        measures_noise: scales the variances to the roughness of the stripe.
    """
    segment = segments_of(line, across)
    if measures_noise:
        variance = variance * noise_scale(across, variance, segment)
    across, variance = smooth_within(line, across, variance, segment, rows)
    return across, variance, segment
