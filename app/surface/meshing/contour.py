"""The triangles on which a field has one value."""

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Points
from app.geometry.mesh import TriangleMesh
from app.surface.meshing.grid import Grid


def contour(grid: Grid, field: NDArray[np.float32], level: float) -> tuple[TriangleMesh, Points]:
    """The surface between what is above the level, inside, and what is below.

    Returns:
        The mesh, and (V, 3) outward unit vectors of its vertices; empty where the field never crosses it.
    """
    # Loaded here: nothing else needs it, and it takes a while.
    from skimage.measure import marching_cubes

    if not field.min() < level < field.max():
        return TriangleMesh.empty(), np.zeros((0, 3))
    places, faces, outward, _ = marching_cubes(  # type: ignore[no-untyped-call]
        field, level, gradient_direction="descent"
    )
    vertices = grid.origin + places.astype(np.float64) * grid.cell_mm
    length = np.linalg.norm(outward, axis=1, keepdims=True)
    directions = outward.astype(np.float64) / np.where(length > 0.0, length, 1.0)
    # Clockwise as they come.
    return TriangleMesh(vertices.astype(np.float32), faces[:, ::-1].astype(np.int32)), directions
