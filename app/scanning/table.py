"""Does the table lie where the calibration has it?"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.geometry.plane import PlaneFit, fit_plane, fit_plane_robust

# Heights within which the table is looked for, mm.
REACH_MM = 25.0
_SECTORS, _RINGS = 24, 8
_CELL_POINTS = 8
_LOW_PERCENTILE = 30.0
_SECTORS_NEEDED = 8
_CELLS_NEEDED = 12
_BAND_SIGMAS = 4.0
_NARROWEST_BAND_MM = 0.5
_SLOPED_MOST = 0.2
# An object's rounded underside is not as flat as a table.
_FLAT_MM = 1.0
_SHARE_ON_TABLE = 0.4
_MOVED_MM = 1.0
_TILTED_DEG = 0.5


@dataclass(frozen=True, slots=True)
class TableCheck:
    """The table as this recording shows it, against z = 0 where the calibration has it.

    Attributes:
        source: `points` or `markers`.
        offset_mm: height of its plane at the axis.
        tilt_deg: its slope.
        rms_mm: how flat it is.
        points: how many points tell.
    """

    source: str
    offset_mm: float
    tilt_deg: float
    rms_mm: float
    points: int

    @property
    def is_moved(self) -> bool:
        return abs(self.offset_mm) > _MOVED_MM or self.tilt_deg > _TILTED_DEG

    @property
    def sentence(self) -> str:
        """What to tell a person; empty where the table lies where it should."""
        if not self.is_moved:
            return ""
        side = "above" if self.offset_mm > 0.0 else "below"
        return (
            f"The table lies {abs(self.offset_mm):.2f} mm {side} where the calibration has it and is "
            f"tilted by {self.tilt_deg:.2f} degrees (seen from its {self.source}): "
            "laser or camera were moved since, or a stated size (board, markers) is wrong; calibrate again."
        )


def check_by_points(points: NDArray[np.float32]) -> TableCheck | None:
    """The lowest flat ring of the cloud; None where too little of the table was seen.

    The table is cut into cells by direction and distance; a plane through the low points of the majority of
    cells leaves out the cells where the object stands.

    Args:
        points: (N, 3) table frame; those further than `REACH_MM` from z = 0 are not looked at.
    """
    near = points[np.abs(points[:, 2]) < REACH_MM].astype(np.float64)
    if len(near) < _CELLS_NEEDED * _CELL_POINTS:
        return None
    radius, direction = np.hypot(near[:, 0], near[:, 1]), np.arctan2(near[:, 1], near[:, 0])
    sector = ((direction + np.pi) / (2.0 * np.pi) * _SECTORS).astype(np.intp) % _SECTORS
    ring = np.minimum((radius / radius.max() * _RINGS).astype(np.intp), _RINGS - 1)
    low, seen = [], set()
    for cell in np.unique(sector * _RINGS + ring):
        inside = near[sector * _RINGS + ring == cell]
        if len(inside) >= _CELL_POINTS:
            height = np.percentile(inside[:, 2], _LOW_PERCENTILE)
            low.append([*np.median(inside[:, :2], axis=0), height])
            seen.add(int(cell) // _RINGS)
    if len(low) < _CELLS_NEEDED or len(seen) < _SECTORS_NEEDED:
        return None
    fit = fit_plane_robust(np.array(low))
    # A wall or the object's side is no table.
    if abs(fit.plane.normal[2]) < 1.0 - _SLOPED_MOST:
        return None
    for _ in range(3):
        distance = fit.plane.signed_distance(near)
        band = max(_BAND_SIGMAS * _spread(distance), _NARROWEST_BAND_MM)
        chosen = np.abs(distance) < band
        if np.count_nonzero(chosen) < _CELLS_NEEDED * _CELL_POINTS:
            return None
        fit = fit_plane(near[chosen])
    cells_on = np.abs(fit.plane.signed_distance(np.array(low))) < _FLAT_MM
    if fit.rms_mm > _FLAT_MM or np.mean(cells_on) < _SHARE_ON_TABLE:
        return None
    return _checked("points", fit)


def check_by_markers(corners: NDArray[np.float64]) -> TableCheck:
    """The plane of the markers' corners (N, 3), table frame."""
    return _checked("markers", fit_plane(corners))


def _checked(source: str, fit: PlaneFit) -> TableCheck:
    normal = fit.plane.normal
    offset = fit.plane.distance_mm / float(normal[2])
    tilt = float(np.degrees(np.arccos(np.clip(abs(normal[2]), 0.0, 1.0))))
    return TableCheck(source, offset, tilt, fit.rms_mm, int(np.count_nonzero(fit.is_inlier)))


def _spread(distance: NDArray[np.float64]) -> float:
    """Robust standard deviation of the points close to the plane."""
    close = distance[np.abs(distance) < 3.0]
    return 1.4826 * float(np.median(np.abs(close))) if len(close) else 0.0
