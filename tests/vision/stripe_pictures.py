"""Pictures of stripes of known centre, for the tests."""

import numpy as np

from app.geometry.arrays import Floats
from app.vision.stripe import Image

LINES, WIDTH = 120, 200


def slanted_centre() -> Floats:
    """Centre (LINES,) of a stripe that leans."""
    centre: Floats = 90.3 + 0.21 * np.arange(LINES, dtype=np.float64)
    return centre


def stripe_light(centre: Floats, sigma_px: float = 2.0, height: float = 160.0, width: int = WIDTH) -> Floats:
    """(L, width) light of a stripe."""
    across = np.arange(width) - centre[:, None]
    light: Floats = height * np.exp(-(across**2) / (2.0 * sigma_px**2))
    return light


def colour_picture(light: Floats, channel: int, background: float | Floats = 20.0) -> Image:
    """A BGR picture whose one channel sees all of the laser and the others a tenth, clipped at 255."""
    picture = np.repeat((light * 0.1 + background)[:, :, None], 3, axis=2)
    picture[:, :, channel] = light + background
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


def grey_picture(light: Floats, background: float | Floats = 20.0) -> Image:
    return np.clip(np.rint(light + background), 0, 255).astype(np.uint8)
