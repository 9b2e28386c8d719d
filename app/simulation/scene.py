"""The true world: a rig, a room, and what stands on the table."""

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats
from app.geometry.transform import RigidTransform
from app.simulation.mesh import Mesh
from app.simulation.noise import Noise
from app.simulation.rig import SimulatedRig

COARSE_BLOCK, FINE_BLOCK = 16, 4


@dataclass(frozen=True, eq=False, slots=True)
class Texture:
    """A print on a body's plane z = 0.

    Attributes:
        albedo: (h, w) share of the light that comes back, 0..1; rows along y, columns along x.
        coarse: albedo of blocks of `COARSE_BLOCK` squared texels; NaN where a block, or one beside it, holds
            an edge.
        fine: the same for blocks of `FINE_BLOCK`.
        origin_mm: (2,) the body's x and y at the outer edge of the first texel.
        texel_mm: side of a texel.
    """

    albedo: NDArray[np.float32]
    coarse: NDArray[np.float32]
    fine: NDArray[np.float32]
    origin_mm: Floats
    texel_mm: float

    @classmethod
    def of(cls, albedo: NDArray[np.float32], origin_mm: Floats, texel_mm: float) -> "Texture":
        return cls(albedo, _plain(albedo, COARSE_BLOCK), _plain(albedo, FINE_BLOCK), origin_mm, texel_mm)


def _plain(albedo: NDArray[np.float32], block: int) -> NDArray[np.float32]:
    """What blocks have in common with all around them, NaN where they have nothing."""
    rows, columns = (-(-size // block) for size in albedo.shape)
    padding = ((0, rows * block - albedo.shape[0]), (0, columns * block - albedo.shape[1]))
    blocks = np.pad(albedo, padding, mode="edge").reshape(rows, block, columns, block)
    square = np.ones((3, 3), np.uint8)
    low = np.asarray(cv2.erode(blocks.min(axis=(1, 3)), square), np.float32)
    high = np.asarray(cv2.dilate(blocks.max(axis=(1, 3)), square), np.float32)
    return np.where(low == high, low, np.float32(np.nan))


@dataclass(frozen=True, eq=False, slots=True)
class Body:
    """Something in the scene.

    Attributes:
        mesh: its surface, in the body's frame.
        pose: table from body, at table angle 0.
        turns: whether it turns with the table; what does not is drawn once.
        is_round: whether turning moves its print alone; its shape is then drawn once.
        texture: printed on the triangles that lie in its plane z = 0, where there is one.
    """

    mesh: Mesh
    pose: RigidTransform
    turns: bool
    texture: Texture | None = None
    is_round: bool = False


@dataclass(frozen=True, slots=True)
class Lighting:
    """The room's light, as grey levels that a white surface has.

    Attributes:
        ambient_grey: from all around.
        lamp_grey: from one lamp, on a surface that faces it.
        backdrop_grey: of the far wall.
    """

    ambient_grey: float = 40.0
    lamp_grey: float = 55.0
    backdrop_grey: float = 26.0

    def brighter(self, factor: float) -> "Lighting":
        """The same room with more light, or exposed for longer."""
        return Lighting(factor * self.ambient_grey, factor * self.lamp_grey, factor * self.backdrop_grey)


@dataclass(frozen=True, eq=False, slots=True)
class Scene:
    """Everything a picture depends on, apart from the table's angle and which lasers are on.

    Attributes:
        scanner: the true rig.
        bodies: what is there, table included.
        lighting: of the room.
        noise: of the sensor.
        lens_blur_px: sigma of what lens and colour filter make of a point.
        is_grey: a camera without colours; pictures are (H, W) instead of (H, W, 3).
    """

    scanner: SimulatedRig
    bodies: tuple[Body, ...]
    lighting: Lighting = field(default_factory=Lighting)
    noise: Noise = field(default_factory=Noise)
    lens_blur_px: float = 0.8
    is_grey: bool = False
