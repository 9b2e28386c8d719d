"""How sharp a picture is: the blur of its sharpest edges."""

import cv2
import numpy as np

from app.vision.stripe import Image

_REBLUR_PX = 2.5
# Noise would pass for edges. What smoothing adds is taken off again, and so is the width of the differences.
_SMOOTH_PX = 1.0
_DIFFERENCE_PX = 3.0**-0.5
_EDGE_SHARE = 0.002
_LEAST_STEEP_GREY = 2.5
_FEWEST = 60


def blur_px(image: Image) -> float:
    """Sigma of what lens and focus make of a sharp edge, pixels; NaN for a picture without edges.

    The picture is blurred once more by a known sigma s: an edge of sigma b loses steepness by the factor
    sqrt(b² + s²) / b (Zhuo and Sim, Defocus map estimation from a single image, 2011).
    """
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image
    plain = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), _SMOOTH_PX)
    steep = _steepness(plain)
    level = max(float(np.quantile(steep, 1.0 - _EDGE_SHARE)), _LEAST_STEEP_GREY)
    # On the edge itself only, not on its flanks.
    is_ridge = (steep >= level) & (steep >= cv2.dilate(steep, np.ones((3, 3), np.uint8)) - 1e-6)
    if np.count_nonzero(is_ridge) < _FEWEST:
        return float("nan")
    softer = _steepness(cv2.GaussianBlur(plain, (0, 0), _REBLUR_PX))
    factors = steep[is_ridge] / np.maximum(softer[is_ridge], 1e-3)
    factor = max(float(np.median(factors)), 1.0 + 1e-3)
    total = _REBLUR_PX / float(np.sqrt(factor**2 - 1.0))
    return float(np.sqrt(max(total**2 - _SMOOTH_PX**2 - _DIFFERENCE_PX**2, 0.0)))


def _steepness(grey: np.ndarray) -> np.ndarray:
    """Grey levels per pixel, by central differences."""
    across = cv2.filter2D(grey, cv2.CV_32F, np.array([[-0.5, 0.0, 0.5]]))
    down = cv2.filter2D(grey, cv2.CV_32F, np.array([[-0.5], [0.0], [0.5]]))
    steep: np.ndarray = cv2.magnitude(across, down)
    return steep
