"""Take the table away, and leave the foot of the thing that stands on it."""

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from app.geometry.arrays import Floats
from app.geometry.cloud import PointCloud
from app.geometry.plane import fit_plane_robust
from app.surface.step import STEPS, Step

_FEWEST = 200
_UPWARDS = 0.85
_SIDEWAYS = 0.6
# A plane that leans more is no turntable.
_LEAST_UPRIGHT = np.cos(np.radians(4.0))
_FIT_SAMPLE = 20_000
# The foot is where points stand this high above the table.
_FOOT_MM, _CELL_MM = 4.0, 1.0
_MOST_CELLS = 1e6


class Table(Step):
    """Removes points on the table's surface and all below it; points that are not finite go too.

    The table is looked for near z = 0: the plane through the majority of what faces upwards there. Where
    there is too little of it, it is taken to be z = 0. Close to it, only the foot of a wall stays: points
    whose surface faces sideways, or of which that is not known, and above which something stands.

    Attributes:
        clearance_mm: how high above the plane a point may still belong to the table.
        search_mm: how far from z = 0 the table may lie.
    """

    clearance_mm: Annotated[
        float,
        Field(
            gt=0.0, le=20.0, title="Clearance, mm",
            description="How high above the table a point may still belong to it, mm.",
        ),
    ] = 0.8  # fmt: skip
    search_mm: Annotated[
        float,
        Field(
            ge=0.0, le=50.0, title="Search, mm", description="How far from height 0 the table may lie, mm."
        ),
    ] = 3.0

    def apply(self, cloud: PointCloud) -> PointCloud:
        points = cloud.points.astype(np.float64)
        up, offset = self._plane(points, cloud.normals)
        height = points @ up - offset
        keep = height > self.clearance_mm
        band = np.flatnonzero(np.abs(height) <= self.clearance_mm)
        is_known = np.any(cloud.normals[band] != 0.0, axis=1)
        upward = cloud.normals[band] @ up
        is_wall = is_known & (upward < _SIDEWAYS)
        foot = keep & (height < self.clearance_mm + _FOOT_MM)
        keep[band] = (is_wall | ~is_known) & _beneath(points[band], points[foot])
        return cloud.select(keep)

    def _plane(self, points: Floats, normals: NDArray[np.float32]) -> tuple[Floats, float]:
        """Upward unit vector of the table and its height along it, mm."""
        low = np.abs(points[:, 2]) <= self.search_mm
        is_unknown = ~np.any(normals != 0.0, axis=1)
        candidates = np.flatnonzero(low & (is_unknown | (normals[:, 2] > _UPWARDS)))
        level = np.array([0.0, 0.0, 1.0]), 0.0
        if len(candidates) < _FEWEST:
            return level
        chosen = points[candidates[:: -(-len(candidates) // _FIT_SAMPLE)]]
        try:
            plane = fit_plane_robust(chosen).plane
        except ValueError:
            return level
        # A `LaserPlane` has its normal turned to positive z: upwards.
        return (plane.normal, plane.distance_mm) if plane.normal[2] > _LEAST_UPRIGHT else level


def _beneath(points: Floats, foot: Floats) -> NDArray[np.bool_]:
    """(N,) which points lie below or right beside others that stand a little higher."""
    if not len(points) or not len(foot):
        return np.zeros(len(points), np.bool_)
    low = np.minimum(points[:, :2].min(axis=0), foot[:, :2].min(axis=0)) - 2.0 * _CELL_MM
    places, stands = (
        np.minimum((each[:, :2] - low) / _CELL_MM, _MOST_CELLS).astype(np.int64) for each in (points, foot)
    )
    width = int(max(places[:, 1].max(), stands[:, 1].max())) + 3
    taken = np.unique(stands[:, 0] * width + stands[:, 1])
    around = np.unique(taken[:, None] + np.array([a * width + b for a in (-1, 0, 1) for b in (-1, 0, 1)]))
    return np.asarray(np.isin(places[:, 0] * width + places[:, 1], around), np.bool_)


STEPS.register("table", Table)
