"""Dark elliptical spots in a picture: what printed dots look like."""

from dataclasses import dataclass

import cv2
import numpy as np

from app.geometry.arrays import Floats, Pixels
from app.vision.stripe import Image

_BLOCK_SHARES = (1 / 6, 1 / 20)
"""Widths of the surroundings a pixel is compared with, as shares of the picture; a dot must be narrower."""
_DARKER = 6
_LEAST_AREA_PX, _LARGEST_AREA_SHARE = 12.0, 1 / 50
_ELLIPSE_TOLERANCE, _LEAST_AXIS_RATIO = 0.12, 0.2
_SAME_PLACE_PX = 2.0


@dataclass(frozen=True, eq=False, slots=True)
class Dots:
    """Spots that might be printed dots.

    Attributes:
        centres: (N, 2) px, good to some tenths.
        sizes: (N,) square root of the area, px.
    """

    centres: Pixels
    sizes: Floats


def find_dots(grey: Image) -> Dots:
    """Spots darker than their surroundings whose outline is an ellipse, however the light falls."""
    centres: list[tuple[float, float]] = []
    sizes: list[float] = []
    smooth = cv2.GaussianBlur(grey, (3, 3), 0)
    for share in _BLOCK_SHARES:
        block = max(15, int(share * max(grey.shape)) | 1)
        dark = cv2.adaptiveThreshold(
            smooth, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV, block, _DARKER
        )
        contours, family = cv2.findContours(dark, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
        for contour, (_, _, _, parent) in zip(contours, [] if family is None else family[0], strict=True):
            # An outline with a parent is that of a hole, a bright spot.
            spot = _spot(contour, _LARGEST_AREA_SHARE * grey.size) if parent < 0 else None
            if spot and not _is_known(spot, centres):
                centres.append(spot[:2])
                sizes.append(spot[2])
    return Dots(np.array(centres, np.float64).reshape(-1, 2), np.array(sizes, np.float64))


def _spot(contour: np.ndarray, largest_px: float) -> tuple[float, float, float] | None:
    """Centre and size of an elliptical outline; the outline runs through the dot's own outermost pixels."""
    if len(contour) < 8:
        return None
    moments = cv2.moments(contour)
    area = moments["m00"]
    if not _LEAST_AREA_PX <= area <= largest_px:
        return None
    xx, yy, xy = (moments[name] / area for name in ("mu20", "mu02", "mu11"))
    determinant, half_trace = xx * yy - xy * xy, (xx + yy) / 2.0
    if determinant <= 0.0:
        return None
    # An ellipse with these second moments has this area; other shapes have less.
    if abs(area / (4.0 * np.pi * np.sqrt(determinant)) - 1.0) > _ELLIPSE_TOLERANCE:
        return None
    root = np.sqrt(max(half_trace**2 - determinant, 0.0))
    if half_trace - root < _LEAST_AXIS_RATIO**2 * (half_trace + root):
        return None
    return moments["m10"] / area, moments["m01"] / area, float(np.sqrt(area))


def _is_known(spot: tuple[float, float, float], centres: list[tuple[float, float]]) -> bool:
    return any(np.hypot(spot[0] - x, spot[1] - y) < max(_SAME_PLACE_PX, 0.3 * spot[2]) for x, y in centres)
