"""The table, for a calibration that knows its axis but not its height: the lowest flat ring of a scan."""

import numpy as np
from numpy.typing import NDArray

from app.scanning.table import REACH_MM, TableCheck, check_by_points

_STEP_MM = 0.4 * REACH_MM
_TILTED_MOST_DEG = 3.0
_MOST_STEPS = 400


def find_table(points: NDArray[np.float32]) -> float:
    """Height of the table in the frame of the points, mm; NaN where no flat ring is seen all around.

    The object's own flat parts lie higher than what it stands on, so the lowest ring is the table.

    Args:
        points: (N, 3) table frame whose origin lies anywhere on the axis.
    """
    if len(points) == 0:
        return float("nan")
    low, high = np.percentile(points[:, 2], [0.1, 99.9])
    steps = min(int((high - low) / _STEP_MM) + 2, _MOST_STEPS)
    for height in low + _STEP_MM * np.arange(steps):
        moved = points - np.array([0.0, 0.0, height], np.float32)
        seen = check_by_points(moved)
        if seen is not None and seen.tilt_deg < _TILTED_MOST_DEG and abs(seen.offset_mm) < _STEP_MM:
            return float(height) + _settled(moved, seen)
    return float("nan")


def _settled(points: NDArray[np.float32], seen: TableCheck) -> float:
    """The offset once more, with the table in the middle of the heights that are looked at."""
    again = check_by_points(points - np.array([0.0, 0.0, seen.offset_mm], np.float32))
    return seen.offset_mm + (again.offset_mm if again is not None else 0.0)
