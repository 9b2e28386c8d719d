"""Where the markers on the table lie, as the calibration file keeps it under its key `platter`."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from app.calibration.record import CalibrationRecord
from app.errors import CalibrationFileError
from app.geometry.arrays import Points

_MOST_MARKERS = 10_000


def platter_entry(layout: Mapping[int, Points], marker_mm: float) -> dict[str, Any]:
    """What is kept: the markers' side and their corners in the table frame at angle zero."""
    return {
        "marker_mm": marker_mm,
        "corners_mm": {str(number): corners.tolist() for number, corners in layout.items()},
    }


def layout_of(record: CalibrationRecord) -> dict[int, Points]:
    """Corners (4, 3) mm of each marker in the table frame; empty where the calibration saw no markers.

    Raises:
        CalibrationFileError: the entry is not of that form.
    """
    entry = record.extra.get("platter")
    if entry is None:
        return {}
    corners = entry.get("corners_mm") if isinstance(entry, Mapping) else None
    if not isinstance(corners, Mapping) or len(corners) > _MOST_MARKERS:
        raise CalibrationFileError(record.source, "platter.corners_mm is not a list of corners by marker")
    layout: dict[int, Points] = {}
    for number, listed in corners.items():
        place = f"platter.corners_mm.{number}"
        try:
            layout[int(number)] = np.array(listed, np.float64)
        except (TypeError, ValueError, OverflowError) as error:
            raise CalibrationFileError(record.source, f"{place} is not four points") from error
        if layout[int(number)].shape != (4, 3) or not np.isfinite(layout[int(number)]).all():
            raise CalibrationFileError(record.source, f"{place} is not four points")
    return layout
