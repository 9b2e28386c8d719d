"""One number for how far a point can be trusted."""

import numpy as np
from numpy.typing import NDArray

from app.scanning.profile import Slice

_FULL_STRENGTH = 40.0
_HARMLESS_SECOND = 0.3
_CLIPPED = 0.8
_USUAL_WIDTH_RATIO = 1.5
_STEEP_COSINE = 0.5
_UNKNOWN_NORMAL = 0.7


def quality_of(part: Slice, normals: NDArray[np.float32]) -> NDArray[np.float32]:
    """0..1 for every point of a slice: the product of five marks, each 1 for an ordinary point.

    - strength: a peak of 40 grey levels and more is 1, a weaker one less in proportion;
    - second peak: 1 up to a share of 0.3, falling to 0 where it is as high as the stripe (a reflection?);
    - clipped core: 0.8, as only the flanks tell the position;
    - width: 1 up to 1.5 times the median width of the profile, then falling as its inverse square;
    - grazing view: 1 where the surface is seen at 60 degrees to its normal or less, falling with the
      cosine beyond; 0.7 where the normal is unknown.
    """
    stripe = part.stripe
    quality = np.clip(stripe.strength / _FULL_STRENGTH, 0.0, 1.0)
    quality = quality * np.clip((1.0 - stripe.second) / (1.0 - _HARMLESS_SECOND), 0.0, 1.0)
    quality *= np.where(stripe.saturated, _CLIPPED, 1.0)
    if len(part):
        usual = _USUAL_WIDTH_RATIO * float(np.median(stripe.width))
        quality *= np.minimum(1.0, usual / np.maximum(stripe.width, 1e-6)) ** 2
    view = part.camera - part.points
    cosine = np.einsum("ij,ij->i", view, normals) / np.sqrt(np.einsum("ij,ij->i", view, view))
    is_known = np.einsum("ij,ij->i", normals, normals) > 0.0
    quality *= np.where(is_known, np.clip(cosine / _STEEP_COSINE, 0.0, 1.0), _UNKNOWN_NORMAL)
    return quality.astype(np.float32)
