"""How much laser light there is in every pixel, and which pixels are lit."""

import cv2
import numpy as np
from numpy.typing import NDArray

from app.vision.kernels import Kernels, kernels
from app.vision.stripe import Image, LaserColour, LaserView

_CHANNELS = {"blue": 0, "green": 1, "red": 2}
# A background structure at least this wide, as a share of the line, is no stripe.
_STRIPE_SHARE = 0.03


def across_lines(view: LaserView) -> tuple[Image, Image | None]:
    """The pictures turned so that every row crosses the stripe once.

    Raises:
        ValueError: the two pictures differ in shape.
    """
    lit, dark = view.lit, view.dark
    if dark is not None and dark.shape != lit.shape:
        raise ValueError(f"lit and dark picture differ in shape: {lit.shape} and {dark.shape}")
    if view.orientation == "vertical":
        return np.ascontiguousarray(lit), None if dark is None else np.ascontiguousarray(dark)
    lit = np.ascontiguousarray(np.swapaxes(lit, 0, 1))
    return lit, None if dark is None else np.ascontiguousarray(np.swapaxes(dark, 0, 1))


def laser_channel(lit: Image, dark: Image | None, colour: LaserColour) -> int:
    """Which channel of a colour picture sees the laser; for `any` the one that gains the most light."""
    if lit.ndim == 2:
        return 0
    if colour != "any":
        return _CHANNELS[colour]
    sample = lit[::8].astype(np.int16)
    gain = sample - np.roll(sample, 8, axis=1) if dark is None else sample - dark[::8]
    brightest = gain.max(axis=1).astype(np.float64).mean(axis=0)
    # Green on a tie: a Bayer sensor has twice as many green pixels.
    return int(np.argmax(brightest + np.array([0.0, 1.0, 0.5])))


def laser_response(view: LaserView) -> Image:
    """Laser light (H, W) in every pixel, grey levels.

    With a dark partner the gain of the laser's channel. Without one how far the channel rises above its
    surroundings along the line, as far as the surroundings turn towards the laser's colour; where a bright
    core has lost its colour the coloured flanks vouch for it.
    """
    lit, dark = across_lines(view)
    channel = laser_channel(lit, dark, view.colour)
    if dark is None:
        response, _ = ridge_response(lit, channel, view.colour)
    elif lit.ndim == 2:
        response = np.asarray(cv2.subtract(lit, dark), np.uint8)
    else:
        response = np.asarray(
            cv2.subtract(cv2.extractChannel(lit, channel), cv2.extractChannel(dark, channel)), np.uint8
        )
    return response if view.orientation == "vertical" else np.swapaxes(response, 0, 1)


def ridge_response(
    lit: Image, channel: int, colour: LaserColour, loops: Kernels | None = None
) -> tuple[Image, Image]:
    """Laser light in a picture without a partner, rows across the stripe.

    Returns:
        response (L, W), how much each pixel looks like laser, and light (L, W), how far it rises above its
        surroundings whatever its colour. The light has the stripe's true shape; the response is cut off where
        the colour does not vouch for all of it.
    """
    if lit.ndim == 2:
        light = _top_hat(lit)
        return light, light
    planes = [np.asarray(plane, np.uint8) for plane in cv2.split(lit)]
    own = planes.pop(channel)
    light = _top_hat(own)
    if colour == "any":
        return light, light
    excess = (loops or kernels()).colour_excess(own, *planes)
    return np.minimum(light, _colour_rise(excess)), light


def laser_mask(response: Image, level: float) -> NDArray[np.bool_]:
    """Which pixels (H, W) are lit: the paper's `threshold()`."""
    _, mask = cv2.threshold(response, level, 255, cv2.THRESH_BINARY)
    lit: NDArray[np.bool_] = mask > 0
    return lit


def _top_hat(plane: Image) -> Image:
    width = max(15, 2 * round(_STRIPE_SHARE * plane.shape[1] / 2) + 1)
    element = np.ones((1, width), np.uint8)
    return np.asarray(cv2.morphologyEx(plane, cv2.MORPH_TOPHAT, element), np.uint8)


def _colour_rise(excess: Image) -> Image:
    """Twice the rise of the laser's channel over the two others, compared with the surroundings.

    Averaged over the few pixels that JPEG and Bayer patterns smear colour over.

    Args:
        excess: half of it, and 128 for none.
    """
    smooth = np.asarray(cv2.blur(excess, (7, 3)), np.uint8)
    rise = _top_hat(smooth)
    return np.asarray(cv2.convertScaleAbs(rise, alpha=4.0), np.uint8)
