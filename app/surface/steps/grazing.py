"""Leave out points on surfaces that the camera saw from the side."""

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from app.geometry.cloud import PointCloud
from app.surface.normals import has_normals
from app.surface.step import STEPS, Step
from app.surface.view_direction import CAMERA_DISTANCE_MM, CAMERA_HEIGHT_MM, knows_angles, towards_camera


class Grazing(Step):
    """Removes points whose surface is turned away from the camera by more than an angle.

    The camera's direction follows from the table angle of a point, and from where the camera stands. A cloud
    without normals or table angles does not know it. There the uncertainty tells: it grows as the view
    becomes grazing, and what is beyond the usual one divided by the cosine goes. Without uncertainty either,
    quality tells: what is below the cosine goes. Points of which nothing is known stay.

    Attributes:
        most_deg: between the normal and the direction to the camera, degrees.
        camera_distance_mm: of the camera from the axis.
        camera_height_mm: of the camera above the table.
    """

    most_deg: Annotated[
        float,
        Field(
            gt=0.0, lt=90.0, title="Angle, degrees",
            description="The most that the surface may be turned away from the camera, degrees. Without "
            "normals and table angles, uncertainty or quality are used instead.",
        ),
    ] = 75.0  # fmt: skip
    camera_distance_mm: Annotated[
        float,
        Field(
            gt=0.0, le=5000.0, title="Camera distance, mm",
            description="From the table's axis to the camera, mm; roughly is enough.",
        ),
    ] = CAMERA_DISTANCE_MM  # fmt: skip
    camera_height_mm: Annotated[
        float,
        Field(
            ge=-5000.0, le=5000.0, title="Camera height, mm",
            description="Of the camera above the table, mm; roughly is enough.",
        ),
    ] = CAMERA_HEIGHT_MM  # fmt: skip

    def apply(self, cloud: PointCloud) -> PointCloud:
        return cloud.select(self._keep(cloud))

    def says(self, cloud: PointCloud) -> str:
        if has_normals(cloud) and knows_angles(cloud):
            return ""
        known = "uncertainty" if np.isfinite(cloud.sigma_mm).any() else "quality"
        return f"The cloud does not know from where it was seen: judged by {known}."

    def _keep(self, cloud: PointCloud) -> NDArray[np.bool_]:
        least = float(np.cos(np.radians(self.most_deg)))
        if has_normals(cloud) and knows_angles(cloud):
            ways = towards_camera(cloud, self.camera_distance_mm, self.camera_height_mm)
            facing = np.einsum("ij,ij->i", cloud.normals, ways)
            is_known = np.any(cloud.normals != 0.0, axis=1)
            # What looks away from the camera altogether was not seen by this one: a joined cloud.
            return np.asarray(~is_known | (np.abs(facing) >= least), np.bool_)
        is_certain = np.isfinite(cloud.sigma_mm)
        if is_certain.any():
            limit = float(np.median(cloud.sigma_mm[is_certain])) / least
            return ~(cloud.sigma_mm > limit)
        return ~(cloud.quality < least)


STEPS.register("grazing", Grazing)
