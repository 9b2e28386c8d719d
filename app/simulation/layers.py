"""The picture's planes, before lasers and noise."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from app.geometry.camera import CameraIntrinsics, RayTable
from app.simulation.scene import Lighting

F32 = NDArray[np.float32]
Box = tuple[int, int, int, int]
"""Top, bottom, left, right; the second and last are not part of it."""


@dataclass(frozen=True, eq=False, slots=True)
class Layers:
    """What has been drawn so far, in a part of the picture.

    Attributes:
        box: which part.
        rays: (h, w, 2) of every pixel at z = 1, distortion taken out.
        depth: (h, w) mm along z, infinite where nothing is.
        owner: (h, w) number of the triangle seen there, counted over all bodies; -1 for none.
        normal: (h, w, 3) unit vectors out of the surface, camera frame.
        albedo: (h, w, 3) blue, green, red, 0..1.
        seen: (h, w, 3) grey levels in the room's light.
    """

    box: Box
    rays: F32
    depth: F32
    owner: NDArray[np.int32]
    normal: F32
    albedo: F32
    seen: F32

    @classmethod
    def blank(cls, rays: F32, backdrop: F32) -> "Layers":
        """A whole picture of nothing but the backdrop."""
        height, width = rays.shape[:2]
        return cls(
            (0, height, 0, width), rays,
            np.full((height, width), np.inf, np.float32), np.full((height, width), -1, np.int32),
            np.zeros((height, width, 3), np.float32), np.zeros((height, width, 3), np.float32),
            backdrop.copy(),
        )  # fmt: skip

    def part(self, box: Box, rays: F32) -> "Layers":
        """A copy of a part of a whole picture, with its rays."""
        where = area(box)
        return Layers(
            box, rays, self.depth[where].copy(), self.owner[where].copy(),
            self.normal[where].copy(), self.albedo[where].copy(), self.seen[where].copy(),
        )  # fmt: skip


def area(box: Box) -> tuple[slice, slice]:
    """For indexing a whole picture."""
    return slice(box[0], box[1]), slice(box[2], box[3])


def grown(box: Box, by: int, size: tuple[int, int]) -> Box:
    """The box with a margin, as far as the picture of that height and width goes; an empty one stays so."""
    if box[0] >= box[1] or box[2] >= box[3]:
        return 0, 0, 0, 0
    return (
        max(0, box[0] - by), min(size[0], box[1] + by),
        max(0, box[2] - by), min(size[1], box[3] + by),
    )  # fmt: skip


def within(box: Box, outer: Box) -> Box:
    """A box counted from the upper left corner of one around it."""
    top, left = outer[0], outer[2]
    return box[0] - top, box[1] - top, box[2] - left, box[3] - left


def rims(outer: Box, inner: Box) -> tuple[Box, ...]:
    """What a box has around one inside it; all of it around an empty one."""
    if inner[0] >= inner[1] or inner[2] >= inner[3]:
        return (outer,)
    return (
        (outer[0], inner[0], outer[2], outer[3]), (inner[1], outer[1], outer[2], outer[3]),
        (inner[0], inner[1], outer[2], inner[2]), (inner[0], inner[1], inner[3], outer[3]),
    )  # fmt: skip


def around(boxes: Sequence[Box]) -> Box:
    """The smallest box about all that are not empty."""
    held = [box for box in boxes if box[0] < box[1] and box[2] < box[3]]
    if not held:
        return 0, 0, 0, 0
    top, bottom, left, right = zip(*held, strict=True)
    return min(top), max(bottom), min(left), max(right)


@lru_cache(maxsize=4)
def camera_rays(camera: CameraIntrinsics) -> F32:
    return RayTable.of(camera).rays


@lru_cache(maxsize=4)
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


def blur_reach(sigma_px: float) -> int:
    """How many pixels a point spreads."""
    return int(np.ceil(3.0 * sigma_px)) if sigma_px > 0.0 else 0


def blurred(image: F32, sigma_px: float) -> F32:
    if sigma_px <= 0.0 or image.size == 0:
        return image
    size = 2 * blur_reach(sigma_px) + 1
    blurred = np.asarray(cv2.GaussianBlur(image, (size, size), sigma_px), np.float32)
    return blurred.reshape(image.shape)
