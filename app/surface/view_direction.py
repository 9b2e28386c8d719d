"""From where a point was seen, as far as its cloud knows."""

import numpy as np

from app.geometry.arrays import Floats
from app.geometry.cloud import PointCloud

CAMERA_DISTANCE_MM = 250.0
CAMERA_HEIGHT_MM = 120.0
# Within a smaller turn the angles may be a mere filling of a file of another program.
_LEAST_TURN_DEG = 1.0


def knows_angles(cloud: PointCloud) -> bool:
    """Whether the points tell at which angles of the table they were seen."""
    angles = cloud.angle_deg[np.isfinite(cloud.angle_deg)]
    return bool(len(angles)) and bool(np.ptp(angles) > _LEAST_TURN_DEG)


def towards_camera(
    cloud: PointCloud, distance_mm: float = CAMERA_DISTANCE_MM, height_mm: float = CAMERA_HEIGHT_MM
) -> Floats:
    """Unit vectors (N, 3) from the points to the camera, table frame.

    At table angle 0 the camera stands in the direction of x. How far away and how high a cloud does not know;
    a few centimetres more or less turn the direction by a few degrees.

    Args:
        distance_mm: of the camera from the axis.
        height_mm: of the camera above the table.
    """
    angle = -np.radians(cloud.angle_deg.astype(np.float64))
    camera = np.column_stack(
        [distance_mm * np.cos(angle), distance_mm * np.sin(angle), np.full(len(cloud), height_mm)]
    )
    ways = camera - cloud.points
    with np.errstate(invalid="ignore", divide="ignore"):
        unit: Floats = ways / np.linalg.norm(ways, axis=1, keepdims=True)
    return unit
