"""A calibrated scanner, and the one step that the scan repeats a million times."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats, Pixels, Points
from app.geometry.axis import TurntableAxis
from app.geometry.camera import CameraIntrinsics, RayTable
from app.geometry.plane import LaserPlane
from app.geometry.transform import RigidTransform


@dataclass(frozen=True, eq=False, slots=True)
class Rig:
    """Enough to turn a stripe pixel into a point.

    Attributes:
        camera: the camera.
        lasers: one plane per laser, by name.
        axis: what the table turns about.
    """

    camera: CameraIntrinsics
    lasers: Mapping[str, LaserPlane]
    axis: TurntableAxis

    def triangulate(self, pixels: Pixels, laser: str, angle_rad: float) -> Points:
        """Where (N, 2) pixels lit by that laser lie on the table: (N, 3) mm, table frame."""
        in_camera = self.lasers[laser].intersect_rays(self.camera.rays(pixels))
        return self.axis.table_from_camera(angle_rad) @ in_camera

    def depth_per_pixel(self, pixels: Pixels, laser: str, step: tuple[float, float]) -> Floats:
        """How far a point moves, in mm, when its pixel moves by one along `step`: (N,).

        Times the stripe's sigma this is the point's sigma.
        """
        here = self.lasers[laser].intersect_rays(self.camera.rays(pixels))
        there = self.lasers[laser].intersect_rays(self.camera.rays(pixels + np.asarray(step) * 0.5))
        moved: Floats = 2.0 * np.linalg.norm(there - here, axis=1)
        return moved


@dataclass(frozen=True, eq=False, slots=True)
class Triangulator:
    """`Rig.triangulate` with everything that does not change computed beforehand.

    Attributes:
        table: ray of every pixel.
        rig: the rig it was made from.
    """

    table: RayTable
    rig: Rig
    _table_from_camera: RigidTransform = field(repr=False)

    @classmethod
    def of(cls, rig: Rig) -> "Triangulator":
        return cls(RayTable.of(rig.camera), rig, rig.axis.table_from_camera(0.0))

    def points(self, pixels: Pixels, laser: str, angle_rad: float) -> NDArray[np.float32]:
        """As `Rig.triangulate`, (N, 3) float32 mm in the table frame.

        The ray meets the plane and is turned back in one 3x3: X = (M ray) * s + t with s from the plane.
        """
        plane = self.rig.lasers[laser]
        still = self._table_from_camera
        cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
        back = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        # The turned ray, and last the ray's share along the plane's normal.
        turn = np.vstack([back @ still.rotation, plane.normal / plane.distance_mm]).astype(np.float32)
        met = turn[:, :2] @ self.table.at(pixels).T
        met += turn[:, 2:]
        along, points = met[3], met[:3]
        along[along <= 0.0] = np.nan
        points /= along
        points += (back @ still.translation).astype(np.float32)[:, None]
        return np.ascontiguousarray(points.T)
