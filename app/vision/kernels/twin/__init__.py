"""The stripe kernels in NumPy and OpenCV: the reference, and what runs where numba is missing.

A kernel works on lines: each row of the arrays it gets crosses the stripe once.
"""

from app.vision.kernels.terms import noise_terms
from app.vision.kernels.twin.colouring import colour_excess
from app.vision.kernels.twin.cutting import cut_windows, cut_windows_between
from app.vision.kernels.twin.fitting import leftovers, misfits, refine
from app.vision.kernels.twin.piecing import along_pieces, has_company, in_long_pieces, median_bend
from app.vision.kernels.twin.searching import find_peaks, find_peaks_between

__all__ = [
    "along_pieces",
    "colour_excess",
    "cut_windows",
    "cut_windows_between",
    "find_peaks",
    "find_peaks_between",
    "has_company",
    "in_long_pieces",
    "leftovers",
    "median_bend",
    "misfits",
    "noise_terms",
    "refine",
]
