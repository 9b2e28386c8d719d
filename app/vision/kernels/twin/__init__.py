"""The stripe kernels in NumPy and OpenCV: the reference, and what runs where numba is missing.

A kernel works on lines: each row of the arrays it gets crosses the stripe once.
"""

from app.vision.kernels.terms import noise_terms
from app.vision.kernels.twin.cutting import cut_windows, cut_windows_between
from app.vision.kernels.twin.fitting import leftovers, refine
from app.vision.kernels.twin.searching import find_peaks, find_peaks_between

__all__ = [
    "cut_windows",
    "cut_windows_between",
    "find_peaks",
    "find_peaks_between",
    "leftovers",
    "noise_terms",
    "refine",
]
