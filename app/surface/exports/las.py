"""Clouds as LAS and LAZ, for programs that come from surveying."""

from typing import BinaryIO

import numpy as np

from app.geometry.cloud import PointCloud

_COORDINATES_AND_COLOURS = 7
_VERSION = "1.4"
_STEP_MM = 0.001
_TO_16_BITS = 257


def write_las(file: BinaryIO, cloud: PointCloud, *, is_packed: bool) -> None:
    """Positions in mm to a micrometre, colours, and the laser as the source of each point."""
    # Loaded here: nothing else needs it.
    import laspy

    header = laspy.LasHeader(point_format=_COORDINATES_AND_COLOURS, version=_VERSION)
    header.scales = np.full(3, _STEP_MM)
    header.offsets = cloud.points.min(axis=0).astype(np.float64) if len(cloud) else np.zeros(3)
    header.generating_software = "Turnscan, unit mm"
    las = laspy.LasData(header)
    las.x, las.y, las.z = cloud.points.T.astype(np.float64)
    las.red, las.green, las.blue = cloud.colours.T.astype(np.uint16) * _TO_16_BITS
    las.point_source_id = cloud.laser.astype(np.uint16)
    las.write(file, do_compress=is_packed)
