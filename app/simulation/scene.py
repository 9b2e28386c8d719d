"""The true world: a rig, a room, and what stands on the table."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats
from app.geometry.transform import RigidTransform
from app.simulation.mesh import Mesh
from app.simulation.noise import Noise
from app.simulation.rig import SimulatedRig


@dataclass(frozen=True, eq=False, slots=True)
class Texture:
    """A print on a body's plane z = 0.

    Attributes:
        albedo: (h, w) share of the light that comes back, 0..1; rows along y, columns along x.
        origin_mm: (2,) the body's x and y at the outer edge of the first texel.
        texel_mm: side of a texel.
    """

    albedo: NDArray[np.float32]
    origin_mm: Floats
    texel_mm: float


@dataclass(frozen=True, eq=False, slots=True)
class Body:
    """Something in the scene.

    Attributes:
        mesh: its surface, in the body's frame.
        pose: table from body, at table angle 0.
        turns: whether it turns with the table; what does not is drawn once.
        texture: printed on the triangles that lie in its plane z = 0, where there is one.
    """

    mesh: Mesh
    pose: RigidTransform
    turns: bool
    texture: Texture | None = None


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


@dataclass(frozen=True, eq=False, slots=True)
class Scene:
    """Everything a picture depends on, apart from the table's angle and which lasers are on.

    Attributes:
        scanner: the true rig.
        bodies: what is there, table included.
        lighting: of the room.
        noise: of the sensor.
        lens_blur_px: sigma of what the lens makes of a point.
        is_grey: a camera without colours; pictures are (H, W) instead of (H, W, 3).
    """

    scanner: SimulatedRig
    bodies: tuple[Body, ...]
    lighting: Lighting = field(default_factory=Lighting)
    noise: Noise = field(default_factory=Noise)
    lens_blur_px: float = 0.45
    is_grey: bool = False
