"""Leave out points that were seen badly."""

from typing import Annotated

import numpy as np
from pydantic import Field

from app.geometry.cloud import PointCloud
from app.surface.step import STEPS, Step


class ByQuality(Step):
    """Keeps points by what the scan itself knows of them.

    Attributes:
        least: quality below which a point goes, 0..1.
        most_sigma_mm: uncertainty above which a point goes, mm; one that is unknown stays.
    """

    least: Annotated[float, Field(ge=0.0, le=1.0)] = 0.3
    most_sigma_mm: Annotated[float, Field(gt=0.0)] | None = None

    def apply(self, cloud: PointCloud) -> PointCloud:
        keep = cloud.quality >= self.least
        if self.most_sigma_mm is not None:
            keep &= ~(cloud.sigma_mm > np.float32(self.most_sigma_mm))
        return cloud.select(keep)


STEPS.register("quality", ByQuality)
