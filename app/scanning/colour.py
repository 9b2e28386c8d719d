"""What colour a point has."""

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Pixels
from app.geometry.rig import Rig
from app.vision.stripe import Image, LaserStripe


def colours_here(image: Image, pixels: Pixels) -> NDArray[np.uint8]:
    """Red, green, blue (N, 3) of a picture at pixels (N, 2), bilinear; black outside."""
    height, width = image.shape[:2]
    u, v = pixels[:, 0], pixels[:, 1]
    is_inside = (u >= 0) & (v >= 0) & (u <= width - 1) & (v <= height - 1)
    u, v = np.where(is_inside, u, 0.0), np.where(is_inside, v, 0.0)
    u0 = np.minimum(u.astype(np.intp), max(width - 2, 0))
    v0 = np.minimum(v.astype(np.intp), max(height - 2, 0))
    u1, v1 = np.minimum(u0 + 1, width - 1), np.minimum(v0 + 1, height - 1)
    du, dv = (u - u0)[:, None], (v - v0)[:, None]
    picture = image if image.ndim == 3 else image[:, :, None]
    upper = picture[v0, u0] * (1.0 - du) + picture[v0, u1] * du
    lower = picture[v1, u0] * (1.0 - du) + picture[v1, u1] * du
    mixed = np.where(is_inside[:, None], upper * (1.0 - dv) + lower * dv, 0.0)
    colours: NDArray[np.uint8] = np.rint(mixed[:, ::-1]).astype(np.uint8)
    return np.ascontiguousarray(np.broadcast_to(colours, (len(pixels), 3)))


def colours_at_angle(
    image: Image, rig: Rig, points: NDArray[np.float32], angle_rad: float
) -> NDArray[np.uint8]:
    """Colours (N, 3) of table points in a picture that was taken at another angle of the table."""
    in_camera = rig.axis.table_from_camera(angle_rad).inverse() @ points.astype(np.float64)
    return colours_here(image, np.nan_to_num(rig.camera.project(in_camera), nan=-1.0))


def colours_of_strength(stripe: LaserStripe) -> NDArray[np.uint8]:
    """Without a colour picture: grey that follows the stripe's brightness, so dark print shows as dark.

    The square root is what a display's gamma would do to light.
    """
    grey = np.rint(255.0 * np.sqrt(np.clip(stripe.strength / 255.0, 0.0, 1.0))).astype(np.uint8)
    return np.repeat(grey[:, None], 3, axis=1)
