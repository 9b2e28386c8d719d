"""The line that the table turns about, and the table frame it spans."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from app.geometry.arrays import Vector3, unit
from app.geometry.transform import RigidTransform, rotation_about


@dataclass(frozen=True, eq=False)
class TurntableAxis:
    """Axis of rotation in the camera frame.

    Attributes:
        point_mm: (3,) a point on the axis.
        direction: (3,) unit vector that points up from the table.
        offset_mm: where the table's plane cuts the axis, along `direction` from `point_mm`;
            NaN where the table is unknown.
    """

    point_mm: Vector3
    direction: Vector3
    offset_mm: float = float("nan")

    @property
    def origin(self) -> Vector3:
        """Origin of the table frame: on the table's plane, or the axis point nearest the camera centre."""
        along = self.offset_mm if np.isfinite(self.offset_mm) else -float(self.point_mm @ self.direction)
        return self.point_mm + along * self.direction

    @cached_property
    def camera_from_table(self) -> RigidTransform:
        """At table angle 0: z up along the axis, x towards the camera as far as the axis allows."""
        z = unit(self.direction)
        towards_camera = -self.origin
        x = unit(towards_camera - (towards_camera @ z) * z)
        return RigidTransform(np.column_stack([x, np.cross(z, x), z]), self.origin)

    def table_from_camera(self, angle_rad: float) -> RigidTransform:
        """Where a point seen at a table angle lies on the table: turned back about the axis.

        Args:
            angle_rad: right-handed about `direction`, so counter-clockwise seen from above.
        """
        back = RigidTransform(rotation_about(np.array([0.0, 0.0, 1.0]), -angle_rad), np.zeros(3))
        return back @ self.camera_from_table.inverse()
