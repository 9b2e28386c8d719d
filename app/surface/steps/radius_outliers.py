"""Leave out points that have too few others around them."""

from typing import Annotated

import numpy as np
from pydantic import Field

from app.geometry.cloud import PointCloud
from app.surface.neighbours import Places, is_finite
from app.surface.step import STEPS, Step


class RadiusOutliers(Step):
    """Removes single points and small groups of them; points that are not finite go too.

    Attributes:
        radius_mm: how far around a point to look.
        least: other points that must lie there.
    """

    radius_mm: Annotated[
        float,
        Field(gt=0.0, le=1000.0, title="Radius, mm", description="How far around each point to look, mm."),
    ] = 1.5
    least: Annotated[
        int,
        Field(ge=1, le=100, title="Least", description="Other points that must lie within the radius."),
    ] = 4

    def apply(self, cloud: PointCloud) -> PointCloud:
        cloud = cloud.select(is_finite(cloud.points))
        places = Places.of(cloud.points)
        if not len(places):
            return cloud
        # Copies of a point count as others: a place is full when enough points lie on it alone.
        copies = np.bincount(places.of_point, minlength=len(places))
        keep = np.zeros(len(places), np.bool_)
        if copies.max() == 1:
            for part, distances, _ in places.nearest(self.least + 1, within_mm=self.radius_mm):
                keep[part] = np.isfinite(distances[:, -1])
        else:
            for part, distances, numbers in places.nearest(self.least + 1, within_mm=self.radius_mm):
                there = np.where(np.isfinite(distances), copies[numbers], 0).sum(axis=1)
                keep[part] = there > self.least
        return cloud.select(keep[places.of_point])

    def for_share(self, share: float) -> "RadiusOutliers":
        return self.model_copy(update={"radius_mm": self.radius_mm / max(share, 1e-9) ** 0.5})


STEPS.register("radius-outliers", RadiusOutliers)
