"""Which stripe points near the markers lie on the table itself and not on what stands on it."""

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Points, Vector3

# By how much a print may differ from its stated size: `fit to page` takes some per cent.
_LARGEST_MISPRINT = 0.07
_GATE_PX = 4.0
_SMALLEST_SHARE = 0.25


def on_bare_table(points: Points, normal: Vector3, distance_mm: float, focal_px: float) -> NDArray[np.bool_]:
    """Mask (N,) of the points that lie on the sheet of markers, at whatever scale it was printed.

    Markers that are smaller than stated are nearer by the same factor, and so is all that lies on their
    sheet. Each point tells the factor that brings it into the laser's plane; points of the sheet agree about
    it, points of an object do not.

    Args:
        points: (N, 3) where the stripe's rays meet the sheet as it is taken to lie, mm, camera frame.
        normal: of the laser's plane.
        distance_mm: of the same.
        focal_px: of the camera.

    Returns:
        all false where fewer than a quarter of the points agree.
    """
    nothing = np.zeros(len(points), np.bool_)
    if not len(points):
        return nothing
    with np.errstate(divide="ignore"):
        scale = distance_mm / (points @ normal)
    pixel = float(np.median(np.linalg.norm(points, axis=1))) / focal_px / abs(distance_mm)
    gate = _GATE_PX * pixel
    known = np.sort(scale[np.abs(scale - 1.0) < _LARGEST_MISPRINT])
    if not len(known):
        return nothing
    first = np.arange(len(known))
    count = np.searchsorted(known, known + 2.0 * gate, side="right") - first
    best = int(np.argmax(count))
    agreed = float(np.median(known[best : best + count[best]]))
    on_table: NDArray[np.bool_] = np.abs(scale - agreed) < gate
    return on_table if np.count_nonzero(on_table) >= _SMALLEST_SHARE * len(points) else nothing
