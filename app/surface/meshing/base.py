"""The side that no scanner sees: what a thing stands on."""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_closing, binary_fill_holes

from app.geometry.arrays import Points
from app.surface.meshing.grid import Grid

# Stray points must not lower the thing's foot.
_STRAY_SHARE, _STRAY_POINTS = 0.0005, 5
_FOOT_CELLS = 1.5
_GAP_CELLS = 3
# A normal that far below the horizon belongs to a side that was seen from below, not to the foot.
_FACING_DOWN = -0.3


def foot_height(points: Points) -> float:
    """Where a thing that stands upright ends below, mm."""
    stray = min(max(_STRAY_POINTS, int(_STRAY_SHARE * len(points))), len(points) - 1)
    return float(np.partition(points[:, 2], stray)[stray])


def footprint(grid: Grid, points: Points, normals: Points, height_mm: float) -> Points:
    """(N, 3) mm: one point for each cell that the thing covers where it stands, all at that height.

    What lies between the lowest points counts as covered: a foot is rarely seen from inside. Not so what
    lies below a side that was seen to face down, such as that of a ball: it does not reach the ground.
    """
    is_low = points[:, 2] < height_mm + _FOOT_CELLS * grid.cell_mm
    filled = binary_fill_holes(binary_closing(_cells(grid, points[is_low]), _square(_GAP_CELLS)))
    overhangs = _cells(grid, points[is_low & (normals[:, 2] < _FACING_DOWN)])
    x, y = np.nonzero(filled & ~binary_closing(overhangs, _square(1)))
    flat = grid.origin[:2] + np.column_stack([x, y]) * grid.cell_mm
    return np.column_stack([flat, np.full(len(flat), height_mm)])


def _cells(grid: Grid, points: Points) -> NDArray[np.bool_]:
    """The columns of the grid in which points lie."""
    covered = np.zeros(grid.shape[:2], np.bool_)
    places = np.round(grid.places(points)[:, :2]).astype(np.int64)
    covered[places[:, 0], places[:, 1]] = True
    return covered


def _square(cells: int) -> NDArray[np.bool_]:
    """Everything so near in both directions."""
    return np.ones((2 * cells + 1, 2 * cells + 1), np.bool_)
