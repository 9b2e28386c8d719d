"""Leave out points that were seen badly."""

from typing import Annotated

from pydantic import Field

from app.geometry.cloud import PointCloud
from app.surface.step import STEPS, Step


class ByQuality(Step):
    """Keeps points by what the scan itself knows of them.

    Attributes:
        least: quality below which a point goes, 0..1.
        most_sigma_mm: uncertainty above which a point goes, mm; one that is unknown stays.
    """

    least: Annotated[
        float,
        Field(
            ge=0.0, le=1.0, title="Least quality",
            description="Points of a lower quality go; 0 to 1, one is best.",
        ),
    ] = 0.3  # fmt: skip
    most_sigma_mm: Annotated[
        float | None,
        Field(
            gt=0.0, title="Most uncertain, mm",
            description="Points that are less sure go, mm; those of which it is unknown stay.",
        ),
    ] = None  # fmt: skip

    def apply(self, cloud: PointCloud) -> PointCloud:
        keep = cloud.quality >= self.least
        if self.most_sigma_mm is not None:
            keep &= ~(cloud.sigma_mm.astype(float) > self.most_sigma_mm)
        return cloud.select(keep)


STEPS.register("quality", ByQuality)
