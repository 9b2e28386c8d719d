"""Small scenes that several tests look at."""

import numpy as np

from app.geometry.transform import RigidTransform
from app.simulation.boards import table_bodies
from app.simulation.noise import Noise
from app.simulation.objects import SimulatedObject
from app.simulation.rig import SimulatedRig
from app.simulation.scene import Body, Scene
from app.vision.markers import PlatterSpec

OFF_AXIS_MM = np.array([5.0, -3.0, 0.0])


def on_the_table(
    scanner: SimulatedRig,
    *items: SimulatedObject,
    platter: PlatterSpec | None = None,
    noise: Noise | None = None,
    lens_blur_px: float = 0.0,
    is_grey: bool = False,
) -> Scene:
    """Objects a little off the axis; without noise and blur unless they are asked for."""
    where = RigidTransform(np.eye(3), OFF_AXIS_MM)
    bodies = [Body(item.mesh, where, True) for item in items]
    return Scene(
        scanner,
        (*table_bodies(scanner.table_radius_mm, platter), *bodies),
        noise=noise or Noise.none(),
        lens_blur_px=lens_blur_px,
        is_grey=is_grey,
    )
