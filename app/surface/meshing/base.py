"""The side that no scanner sees: what a thing stands on."""

import numpy as np
from scipy.ndimage import binary_closing, binary_fill_holes

from app.geometry.arrays import Points
from app.surface.meshing.grid import Grid

# Stray points must not lower the thing's foot.
_LOWEST_PERCENTILE = 0.2
_FOOT_CELLS = 1.5
_GAP_CELLS = 3


def foot_height(points: Points) -> float:
    """Where a thing that stands upright ends below, mm."""
    return float(np.percentile(points[:, 2], _LOWEST_PERCENTILE))


def footprint(grid: Grid, points: Points, height_mm: float) -> Points:
    """(N, 3) mm: one point for each cell that the thing covers where it stands, all at that height.

    What lies between the lowest points counts as covered: a foot is rarely seen from inside.
    """
    low = points[points[:, 2] < height_mm + _FOOT_CELLS * grid.cell_mm]
    covered = np.zeros(grid.shape[:2], np.bool_)
    places = np.round(grid.places(low)[:, :2]).astype(np.int64)
    covered[places[:, 0], places[:, 1]] = True
    around = np.ones((2 * _GAP_CELLS + 1, 2 * _GAP_CELLS + 1), np.bool_)
    filled = binary_fill_holes(binary_closing(covered, around))
    x, y = np.nonzero(filled)
    flat = grid.origin[:2] + np.column_stack([x, y]) * grid.cell_mm
    return np.column_stack([flat, np.full(len(flat), height_mm)])
