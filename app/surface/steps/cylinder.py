"""Keep what lies in an upright cylinder, or take it away."""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from app.geometry.cloud import PointCloud
from app.surface.step import STEPS, Step


class Cylinder(Step):
    """A cylinder that stands upright on the table: what turns with it fits into one.

    Attributes:
        radius_mm: of the cylinder.
        centre_mm: x and y of its axis; the table's own axis is 0, 0.
        bottom_mm, top_mm: heights where it begins and ends, z.
        keep: what stays. Points that are not finite lie outside.
    """

    radius_mm: Annotated[
        float, Field(gt=0.0, le=10_000.0, title="Radius, mm", description="Of the cylinder, mm.")
    ] = 100.0
    centre_mm: Annotated[
        tuple[float, float],
        Field(title="Centre, mm", description="x and y of its axis, mm; the table's axis is 0, 0."),
    ] = (0.0, 0.0)
    bottom_mm: Annotated[float, Field(title="Bottom, mm", description="Height where it begins, mm.")] = 0.0
    top_mm: Annotated[float, Field(title="Top, mm", description="Height where it ends, mm.")] = 200.0
    keep: Annotated[Literal["inside", "outside"], Field(title="Keep", description="Which points stay.")] = (
        "inside"
    )

    def apply(self, cloud: PointCloud) -> PointCloud:
        x, y, z = cloud.points.T.astype(np.float64)
        inside = np.hypot(x - self.centre_mm[0], y - self.centre_mm[1]) <= self.radius_mm
        inside &= (z >= self.bottom_mm) & (z <= self.top_mm)
        return cloud.select(inside if self.keep == "inside" else ~inside)


STEPS.register("cylinder", Cylinder)
