"""Which part of space belongs to the result."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.errors import OptionError
from app.geometry.platter import MarkerLayout
from app.geometry.rig import Rig

# An object wider than the camera is far away would not fit into the picture.
_RADIUS_PER_DISTANCE = 0.5
_RADIUS_PER_MARKER = 1.25
# The table's own surface is kept, noise and all; what hangs below it is not.
_BELOW_TABLE_MM = 5.0


@dataclass(frozen=True, slots=True)
class Region:
    """A cylinder about the axis, table frame.

    Attributes:
        radius_mm: points further from the axis are left out.
        lowest_mm, highest_mm: heights above the table between which points are kept.
    """

    radius_mm: float = float("inf")
    lowest_mm: float = float("-inf")
    highest_mm: float = float("inf")

    def __post_init__(self) -> None:
        if not self.radius_mm > 0.0:
            raise OptionError(
                f"No point lies within {self.radius_mm:g} mm of the axis.", "Give a radius above zero."
            )
        if not self.lowest_mm < self.highest_mm:
            raise OptionError(
                f"No point lies above {self.lowest_mm:g} mm and below {self.highest_mm:g} mm.",
                "Give a height to keep points above that is less than the one to keep them below.",
            )

    def holds(self, points: NDArray[np.floating]) -> NDArray[np.bool_]:
        """Which of (N, 3) points lie inside."""
        inside: NDArray[np.bool_] = (
            self.within_radius(points) & (points[:, 2] >= self.lowest_mm) & (points[:, 2] <= self.highest_mm)
        )
        return inside

    def within_radius(self, points: NDArray[np.floating]) -> NDArray[np.bool_]:
        near: NDArray[np.bool_] = points[:, 0] ** 2 + points[:, 1] ** 2 <= self.radius_mm**2
        return near


def default_region(rig: Rig, layout: MarkerLayout | None = None) -> Region:
    """Half as wide as the camera is far from the axis; from just below the table, where that is known.

    Where markers lie on the table, they tell how large it is: a quarter more than the furthest of them.
    """
    distance_mm = float(np.linalg.norm(np.cross(rig.axis.point_mm, rig.axis.direction)))
    lowest = -_BELOW_TABLE_MM if np.isfinite(rig.axis.offset_mm) else float("-inf")
    radius = _RADIUS_PER_DISTANCE * distance_mm
    if layout:
        furthest = max(float(np.hypot(corners[:, 0], corners[:, 1]).max()) for corners in layout.values())
        radius = min(radius, _RADIUS_PER_MARKER * furthest)
    return Region(radius, lowest)
