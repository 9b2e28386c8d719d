"""Leave out points that stand further from their neighbours than is usual."""

from typing import Annotated

import numpy as np
from pydantic import Field

from app.geometry.cloud import PointCloud
from app.surface.neighbours import Places, is_finite
from app.surface.step import STEPS, Step

# Towards its edge, and where it was seen at a slant, a surface has fewer points, all of them further apart.
# An outlier is so many times further from its neighbours than those are from theirs.
_ALONE = 1.3
# So many times the limit nothing is only sparse.
_FAR = 2.0


class StatisticalOutliers(Step):
    """Removes what flies about, however dense the cloud is; points that are not finite go too.

    The mean distance to its neighbours is compared with that of all points. What is usual, and how much it
    varies, are taken from the middle half, so that the outliers themselves do not stretch the limit. Beyond
    it, points stay that are hardly further from their neighbours than those are from theirs.

    Attributes:
        neighbours: how many are looked at.
        most_deviations: standard deviations above the usual distance at which a point goes.
    """

    neighbours: Annotated[
        int, Field(ge=1, le=100, title="Neighbours", description="How many neighbours of a point to look at.")
    ] = 8
    most_deviations: Annotated[
        float,
        Field(
            gt=0.0, le=100.0, title="Deviations",
            description="How many standard deviations further than usual from its neighbours a point may be.",
        ),
    ] = 4.0  # fmt: skip

    def apply(self, cloud: PointCloud) -> PointCloud:
        cloud = cloud.select(is_finite(cloud.points))
        places = Places.of(cloud.points)
        if len(places) <= self.neighbours:
            return cloud
        distance = np.empty(len(places))
        for part, distances, _ in places.nearest(self.neighbours + 1):
            distance[part] = distances[:, 1:].mean(axis=1)
        low, usual, high = np.quantile(distance, [0.25, 0.5, 0.75])
        # 1.349 standard deviations of a normal distribution lie between its quartiles; on a perfect grid,
        # where nothing varies, a tenth of the distance itself is let pass.
        limit = usual + self.most_deviations * max((high - low) / 1.349, 0.1 * usual)
        is_outlier = distance > limit
        far = np.flatnonzero(is_outlier & (distance <= _FAR * limit))
        for part, _, numbers in places.nearest(self.neighbours + 1, places.points[far]):
            around = np.median(distance[numbers[:, 1:]], axis=1)
            is_outlier[far[part]] = distance[far[part]] > _ALONE * around
        return cloud.select(~is_outlier[places.of_point])


STEPS.register("statistical-outliers", StatisticalOutliers)
