"""Mend what two lasers see in different places."""

from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from app.geometry.cloud import PointCloud
from app.surface.laser_agreement import LaserMap, map_lasers, moved_together
from app.surface.normals import with_normals
from app.surface.step import STEPS, Step


class LasersAgree(Step):
    """Finds where the points of two lasers lie apart though they saw one surface, and mends it.

    Where a constant shift in the room explains a disagreement, as an error of the calibration does, each
    laser is moved by its half of it. What still lies apart by more than the limit is settled at each place
    for the better of the two: with the smaller sigma, or the higher quality where no sigma is known.

    Attributes:
        most_mm: distance along the normal that is let pass.
        within_mm: surfaces further apart than this are different ones, such as both sides of a wall.
        mend: `correct` moves, then removes; `remove` only removes; `move` only moves.
    """

    most_mm: Annotated[
        float,
        Field(gt=0.0, le=10.0, title="Let pass, mm", description="How far two lasers may lie apart, mm."),
    ] = 0.3
    within_mm: Annotated[
        float,
        Field(
            gt=0.0, le=20.0, title="Within, mm",
            description="Surfaces further apart than this are different ones, mm.",
        ),
    ] = 2.0  # fmt: skip
    mend: Annotated[
        Literal["correct", "remove", "move"],
        Field(title="Mend", description="Move the lasers together, remove the worse points, or both."),
    ] = "correct"

    def apply(self, cloud: PointCloud) -> PointCloud:
        if len(np.unique(cloud.laser)) < 2:
            return cloud
        cloud = with_normals(cloud)
        found = map_lasers(cloud, self.within_mm)
        if self.mend != "remove" and found.shifts:
            cloud = replace(cloud, points=moved_together(cloud, found.shifts))
            found = map_lasers(cloud, self.within_mm)
        return cloud if self.mend == "move" else cloud.select(~self._is_worse(cloud, found))

    def says(self, cloud: PointCloud) -> str:
        findings = map_lasers(with_normals(cloud), self.within_mm).findings
        return " ".join(
            f"{each.first} and {each.second} lie {each.median_mm:.3f} mm apart, where both saw the surface "
            f"({each.share:.0%}); {each.median_after_mm:.3f} mm without a constant shift."
            for each in findings
        )

    def _is_worse(self, cloud: PointCloud, found: LaserMap) -> NDArray[np.bool_]:
        """(N,) which points lie too far from another laser's, and are the less sure."""
        worse = np.zeros(len(cloud), np.bool_)
        apart = np.flatnonzero(np.abs(found.distance_mm) > self.most_mm)
        other = found.partner[apart]
        mine, theirs = cloud.sigma_mm[apart], cloud.sigma_mm[other]
        by_quality = cloud.quality[apart] < cloud.quality[other]
        by_order = (cloud.quality[apart] == cloud.quality[other]) & (cloud.laser[apart] > cloud.laser[other])
        is_known = np.isfinite(mine) & np.isfinite(theirs) & (mine != theirs)
        worse[apart] = np.where(is_known, mine > theirs, by_quality | by_order)
        return worse


STEPS.register("lasers-agree", LasersAgree)
