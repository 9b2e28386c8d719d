"""How sharp a picture is: the blur of its sharpest edges."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from app.vision.stripe import Image

# How much the picture is blurred once more; the second where the first changes too little.
_REBLURS_PX = (1.5, 3.0)
_GOOD_FOR = 1.2
# Noise would pass for edges. What smoothing adds is taken off again, and so is the width of the differences.
_SMOOTH_PX = 0.7
_DIFFERENCE_PX = 3.0**-0.5
_EDGE_SHARE = 0.002
_LEAST_STEEP_GREY = 2.0
_FEWEST = 60

_Plane = NDArray[np.float32]


def blur_px(image: Image) -> float:
    """Sigma of what lens and focus make of a sharp edge, pixels; NaN for a picture without edges.

    The picture is blurred once more by a known sigma s: an edge of sigma b loses steepness by the factor
    sqrt(b² + s²) / b (Zhuo and Sim, Defocus map estimation from a single image, 2011).
    """
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image
    plain = np.asarray(cv2.GaussianBlur(grey.astype(np.float32), (0, 0), _SMOOTH_PX), np.float32)
    steep = _steepness(plain)
    is_edge = steep >= max(float(np.quantile(steep, 1.0 - _EDGE_SHARE)), _LEAST_STEEP_GREY)
    if np.count_nonzero(is_edge) < _FEWEST:
        return math.nan
    blur = math.nan
    for reblur in _REBLURS_PX:
        softer = _steepness(np.asarray(cv2.GaussianBlur(plain, (0, 0), reblur), np.float32))
        factor = float(np.median(steep[is_edge] / np.maximum(softer[is_edge], 1e-3)))
        seen = reblur / math.sqrt(max(factor**2 - 1.0, 1e-3))
        blur = math.sqrt(max(seen**2 - _SMOOTH_PX**2 - _DIFFERENCE_PX**2, 0.0))
        if blur < _GOOD_FOR * reblur:
            break
    return blur


def _steepness(grey: _Plane) -> _Plane:
    """Grey levels per pixel, by central differences."""
    across = cv2.filter2D(grey, cv2.CV_32F, np.array([[-0.5, 0.0, 0.5]]))
    down = cv2.filter2D(grey, cv2.CV_32F, np.array([[-0.5], [0.0], [0.5]]))
    return np.asarray(cv2.magnitude(across, down), np.float32)
