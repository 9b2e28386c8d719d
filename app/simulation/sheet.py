"""A laser's sheet of light: its directions, and where its shadows are looked for."""

from dataclasses import dataclass

import numpy as np

from app.geometry.arrays import Floats, unit
from app.simulation.rig import LaserSource
from app.simulation.scene import Scene

FAN_BINS = 16384
# In standard deviations from the middle of the sheet.
_SLICES = np.array([-4.0, -3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0, 4.0])


@dataclass(frozen=True, eq=False, slots=True)
class Sheet:
    """Directions of a laser's fan, camera frame."""

    forward: Floats
    sideways: Floats
    offsets_mm: Floats
    cosine: Floats
    sine: Floats

    @classmethod
    def of(cls, scene: Scene, source: LaserSource, normal: Floats) -> "Sheet":
        towards = scene.scanner.rig.axis.origin - source.position_mm
        forward = unit(towards - (towards @ normal) * normal)
        turn = np.linspace(-source.half_fan_rad, source.half_fan_rad, FAN_BINS)
        return cls(forward, np.cross(normal, forward), _SLICES * source.sigma_mm, np.cos(turn), np.sin(turn))
