"""Which unknowns an adjustment may change, and which are held because nothing could tell them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from app.calibration.bundle import Columns, Corners, State

Indices = NDArray[np.intp]

_FEWEST_FOR_SCALE = 150


def free_columns(
    state: State,
    corners: Corners,
    camera_columns: Sequence[int],
    *,
    has_axis: bool,
    on_table: int,
) -> Indices:
    """Columns (F,) of the parameter vector that the views can tell.

    Args:
        camera_columns: which of the camera's numbers may change.
        has_axis: whether anything turned.
        on_table: how many stripe points lie on the sheet of markers.
    """
    at = Columns.of(state)
    free = np.ones(at.total, np.bool_)
    free[:9] = False
    free[list(camera_columns)] = True
    free[9:13] = has_axis
    for angle in _gauge_angles(len(state.angles), corners):
        free[at.angles + angle] = False
    # The first marker is the origin of the sheet; its side is known only against the laser's plane.
    free[at.layout : at.layout + 3] = False
    free[at.side] = on_table >= _FEWEST_FOR_SCALE
    return np.flatnonzero(free)


def _gauge_angles(count: int, corners: Corners) -> list[int]:
    """One angle of each group that bodies tie together: a body and its angles can turn as one."""
    leader = list(range(count))

    def find(angle: int) -> int:
        while leader[angle] != angle:
            angle = leader[angle]
        return angle

    first: dict[int, int] = {}
    pairs = np.unique(np.column_stack([corners.body, corners.angle]), axis=0)
    for body, angle in pairs[pairs[:, 1] >= 0].tolist():
        if body in first:
            leader[find(angle)] = find(first[body])
        else:
            first[body] = angle
    return sorted({find(angle) for angle in range(count)})
