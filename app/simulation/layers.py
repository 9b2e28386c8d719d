"""The picture's planes, before lasers and noise."""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats
from app.geometry.camera import CameraIntrinsics, RayTable
from app.simulation.scene import Lighting

F32 = NDArray[np.float32]
Box = tuple[int, int, int, int]
"""Top, bottom, left, right; the second and last are not part of it."""


@dataclass(frozen=True, eq=False, slots=True)
class Layers:
    """What has been drawn so far.

    Attributes:
        depth: (H, W) mm along z, infinite where nothing is.
        owner: (H, W) number of the triangle seen there, counted over all bodies; -1 for none.
        normal: (H, W, 3) unit vectors out of the surface, camera frame.
        albedo: (H, W, 3) blue, green, red, 0..1.
        seen: (H, W, 3) grey levels in the room's light.
    """

    depth: F32
    owner: NDArray[np.int32]
    normal: F32
    albedo: F32
    seen: F32

    @classmethod
    def blank(cls, width: int, height: int, backdrop: F32) -> "Layers":
        return cls(
            np.full((height, width), np.inf, np.float32), np.full((height, width), -1, np.int32),
            np.zeros((height, width, 3), np.float32), np.zeros((height, width, 3), np.float32), backdrop,
        )  # fmt: skip

    def copy(self) -> "Layers":
        return Layers(
            self.depth.copy(), self.owner.copy(), self.normal.copy(), self.albedo.copy(), self.seen.copy()
        )


@lru_cache(maxsize=4)
def camera_rays(camera: CameraIntrinsics) -> F32:
    return RayTable.of(camera).rays


def projected(camera: CameraIntrinsics, vertices: Floats) -> Floats:
    """Pixels (V, 2); far outside the picture without distortion, which folds back there for some lenses."""
    pixels = camera.project(vertices)
    with np.errstate(divide="ignore", invalid="ignore"):
        flat = vertices[:, :2] / vertices[:, 2:]
    m, (width, height) = camera.matrix, camera.size
    straight = flat * [m[0, 0], m[1, 1]] + [m[0, 2], m[1, 2]]
    is_far = (np.abs(straight - [width / 2.0, height / 2.0]) > [0.8 * width, 0.8 * height]).any(axis=1)
    return np.where(is_far[:, None], straight, pixels)


def backdrop(width: int, height: int, lighting: Lighting) -> F32:
    """A far wall out of focus: a soft gradient and some blurred things before it."""
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, width), np.linspace(-1.0, 1.0, height))
    glow = 0.75 + 0.35 * x * 0.6 - 0.3 * y - 0.2 * x * x
    for cx, cy, wide, strength in ((-0.7, -0.6, 0.25, 0.5), (0.5, -0.8, 0.35, -0.35), (0.85, -0.2, 0.2, 0.3)):
        glow += strength * np.exp(-((x - cx) ** 2 + ((y - cy) * 0.6) ** 2) / (2.0 * wide**2))
    colour = np.array([0.86, 0.95, 1.0])
    backdrop: F32 = (lighting.backdrop_grey * np.clip(glow, 0.1, None)[:, :, None] * colour).astype(
        np.float32
    )
    return backdrop


def blurred(image: F32, sigma_px: float) -> F32:
    if sigma_px <= 0.0:
        return image
    size = 2 * int(np.ceil(3.0 * sigma_px)) + 1
    blurred = np.asarray(cv2.GaussianBlur(image, (size, size), sigma_px), np.float32)
    return blurred.reshape(image.shape)
