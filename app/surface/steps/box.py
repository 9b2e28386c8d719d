"""Keep what lies in a box, or take it away."""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from app.geometry.cloud import PointCloud
from app.surface.step import STEPS, Step

Corner = tuple[float, float, float]


class Box(Step):
    """A box along the axes of the table frame.

    Attributes:
        low, high: its corners x, y, z in mm.
        keep: what stays. Points that are not finite lie outside.
    """

    low: Annotated[Corner, Field(title="Low corner, mm", description="Least x, y and z, mm.")] = (
        -100.0, -100.0, 0.0,
    )  # fmt: skip
    high: Annotated[Corner, Field(title="High corner, mm", description="Greatest x, y and z, mm.")] = (
        100.0, 100.0, 200.0,
    )  # fmt: skip
    keep: Annotated[Literal["inside", "outside"], Field(title="Keep", description="Which points stay.")] = (
        "inside"
    )

    def apply(self, cloud: PointCloud) -> PointCloud:
        within = (cloud.points >= self.low) & (cloud.points <= self.high)
        inside = np.asarray(within.all(axis=1), np.bool_)
        return cloud.select(inside if self.keep == "inside" else ~inside)


STEPS.register("box", Box)
