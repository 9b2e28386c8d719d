"""Which point of the cloud lies under a place in somebody's view."""

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Vector3, unit
from app.geometry.transform import RigidTransform

Matrix4: TypeAlias = NDArray[np.float64]
"""(4, 4), by rows."""

# As far from the place as a finger or an unsteady hand may be, in parts of the view's height.
_REACH = 0.02
# What lies so much deeper than the foremost point is behind it, mm and in parts of the distance.
_DEPTH_MM, _DEPTH = 2.0, 0.01


@dataclass(frozen=True, eq=False, slots=True)
class Ray:
    """From an eye through a place in its view, table frame.

    Attributes:
        origin: of the eye, mm.
        direction: unit vector.
        spread: of the view's height, at a distance of 1.
        right, up: of the view, unit vectors.
    """

    origin: Vector3
    direction: Vector3
    spread: float
    right: Vector3
    up: Vector3

    @classmethod
    def through(
        cls, table_from_eye: RigidTransform, fov_rad: float, aspect: float, across: float, down: float
    ) -> "Ray":
        """Through a place of the view.

        Args:
            table_from_eye: where it looks from; x right, y down, z ahead.
            fov_rad: from the view's upper to its lower rim.
            aspect: its width by its height.
            across, down: the place, 0..1 from its upper left corner.
        """
        half = math.tan(fov_rad / 2.0)
        ahead = np.array([(2.0 * across - 1.0) * half * aspect, (2.0 * down - 1.0) * half, 1.0])
        turned = table_from_eye.rotation
        return cls(table_from_eye.translation, unit(turned @ ahead), 2.0 * half, turned[:, 0], -turned[:, 1])


def view_matrix(eye_from_table: RigidTransform, fov_rad: float, aspect: float) -> Matrix4:
    """From (x, y, z, 1) of the table frame to a view's plane, as `Lasso` takes it.

    The first two results, divided by the fourth, are -1..1 from left to right and from top to bottom; the
    fourth is the distance ahead in mm. Arguments as of `Ray.through`.
    """
    half = math.tan(fov_rad / 2.0)
    x, y, z = np.column_stack([eye_from_table.rotation, eye_from_table.translation])
    return np.array([x / (half * aspect), y / half, [0.0, 0.0, 0.0, 1.0], z])


def point_under(ray: Ray, points: NDArray[np.float32]) -> Vector3 | None:
    """The foremost of (N, 3) points that lie close to the ray; of those at its depth, the closest to it."""
    from_eye = points - ray.origin.astype(np.float32)
    depth = from_eye @ ray.direction.astype(np.float32)
    aside = np.sqrt(np.maximum(np.einsum("ij,ij->i", from_eye, from_eye) - depth**2, 0.0))
    is_near = (depth > 0.0) & (aside <= _REACH * ray.spread * depth)
    if not is_near.any():
        return None
    front = float(depth[is_near].min())
    candidates = np.flatnonzero(is_near & (depth <= front + _DEPTH_MM + _DEPTH * front))
    closest: Vector3 = points[candidates[np.argmin(aside[candidates])]].astype(np.float64)
    return closest
