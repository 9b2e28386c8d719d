"""A part of a picture, drawn by its corners as shares of width and height, so that it fits any size."""

from collections.abc import Sequence
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from app.vision.stripe import LaserStripe

Polygon: TypeAlias = tuple[tuple[float, float], ...]
MOST_CORNERS = 64


def is_polygon(corners: object) -> bool:
    """Whether these are 3 to `MOST_CORNERS` corners within the picture, or none for all of it."""
    try:
        points = np.asarray(corners, np.float64).reshape(-1, 2)
    except (TypeError, ValueError):
        return False
    is_inside = bool(((points >= 0.0) & (points <= 1.0)).all())
    return is_inside and len(points) <= MOST_CORNERS and len(points) not in (1, 2)


def polygon_mask(corners: Sequence[tuple[float, float]], size: tuple[int, int]) -> NDArray[np.bool_]:
    """Which pixels (H, W) of a picture of that width and height lie inside."""
    width, height = size
    pixels = np.rint(np.array(corners) * (width, height) - 0.5).astype(np.int32)
    return np.asarray(cv2.fillPoly(np.zeros((height, width), np.uint8), [pixels], 1)) > 0


def stripe_inside(stripe: LaserStripe, mask: NDArray[np.bool_]) -> LaserStripe:
    """What of a stripe lies on the pixels of a mask (H, W)."""
    if not len(stripe):
        return stripe
    height, width = mask.shape
    u, v = np.rint(stripe.pixels).astype(np.intp).T
    return stripe.select(mask[np.clip(v, 0, height - 1), np.clip(u, 0, width - 1)])
