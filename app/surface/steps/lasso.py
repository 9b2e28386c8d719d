"""Keep what lies in an outline drawn on a view, or take it away."""

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from app.geometry.arrays import Floats
from app.geometry.cloud import PointCloud
from app.surface.step import STEPS, Step

Row = tuple[float, float, float, float]
Corner2 = tuple[float, float]
_AT_ONCE = 500_000


class Lasso(Step):
    """All points, near and far, that a view shows inside a polygon.

    Attributes:
        view: 4x4 matrix by rows that takes (x, y, z, 1) of the table frame, mm, to the view: its first
            two results divided by its fourth are the place in the view's plane. Where the fourth is not
            above zero, a point lies behind the viewer and therefore outside.
        polygon: corners in that plane, in order; with fewer than three it encloses nothing.
        keep: what stays.
    """

    view: Annotated[
        tuple[Row, Row, Row, Row],
        Field(
            title="View", description="4x4 matrix by rows, from x, y, z, 1 of the table frame to the view."
        ),
    ] = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    polygon: Annotated[
        tuple[Corner2, ...],
        Field(max_length=10_000, title="Outline", description="Corners of the outline in the view's plane."),
    ] = ()
    keep: Annotated[Literal["inside", "outside"], Field(title="Keep", description="Which points stay.")] = (
        "outside"
    )

    def apply(self, cloud: PointCloud) -> PointCloud:
        inside = np.zeros(len(cloud), np.bool_)
        if len(self.polygon) >= 3:
            matrix, polygon = np.array(self.view), np.array(self.polygon)
            # A point at the end of the world is seen nowhere.
            with np.errstate(all="ignore"):
                for start in range(0, len(cloud), _AT_ONCE):
                    part = slice(start, start + _AT_ONCE)
                    inside[part] = _seen_inside(cloud.points[part], matrix, polygon)
        return cloud.select(inside if self.keep == "inside" else ~inside)


def _seen_inside(points: NDArray[np.float32], matrix: Floats, polygon: Floats) -> NDArray[np.bool_]:
    """(N,) which of points (N, 3) the view shows within the polygon."""
    seen = points @ matrix[:, :3].T + matrix[:, 3]
    u, v = (seen[:, :2] / seen[:, 3:]).T
    low, high = polygon.min(axis=0), polygon.max(axis=0)
    inside = (seen[:, 3] > 0.0) & (u >= low[0]) & (u <= high[0]) & (v >= low[1]) & (v <= high[1])
    which = np.flatnonzero(inside)
    inside[which] = _within(u[which], v[which], polygon)
    return np.asarray(inside, np.bool_)


def _within(u: Floats, v: Floats, polygon: Floats) -> NDArray[np.bool_]:
    """(N,) by how often a line to the right crosses the outline: odd is inside."""
    is_odd = np.zeros(len(u), np.bool_)
    for (ax, ay), (bx, by) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        if ay == by:
            continue
        is_beside = (ay > v) != (by > v)
        is_odd ^= is_beside & (u < ax + (v - ay) * (bx - ax) / (by - ay))
    return is_odd


STEPS.register("lasso", Lasso)
