"""Clouds as LAS and LAZ, for programs that come from surveying."""

from typing import BinaryIO

import numpy as np

from app.geometry.cloud import PointCloud

_COORDINATES_AND_COLOURS = 7
_VERSION = "1.4"
_STEP_MM = 0.001
# Places are counted in steps, as 32 bits with a sign.
_MOST_STEPS = 2.0**31 - 2.0
_TO_16_BITS = 257


def write_las(file: BinaryIO, cloud: PointCloud, *, is_packed: bool) -> None:
    """Positions in mm, colours, and the laser as the source of each point.

    Positions are kept to a micrometre; less finely where a cloud is more than two kilometres wide.
    """
    # Loaded here: nothing else needs it.
    import laspy

    header = laspy.LasHeader(point_format=_COORDINATES_AND_COLOURS, version=_VERSION)
    places = cloud.points.astype(np.float64)
    low, high = (places.min(axis=0), places.max(axis=0)) if len(cloud) else np.zeros((2, 3))
    header.scales = np.maximum(_STEP_MM, (high - low) / _MOST_STEPS)
    header.offsets = low
    header.generating_software = "Turnscan, unit mm"
    las = laspy.LasData(header)
    las.x, las.y, las.z = places.T
    las.red, las.green, las.blue = cloud.colours.T.astype(np.uint16) * _TO_16_BITS
    las.point_source_id = cloud.laser.astype(np.uint16)
    las.write(file, do_compress=is_packed)
