"""What lies near any place of a scan's surroundings, looked up instead of searched."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, distance_transform_edt

from app.geometry.arrays import Floats, Points, Vector3
from app.surface.joining.sample import Sample

# Of what lies far apart for its size, the cells are larger: about 20 bytes each.
_MOST_CELLS = 20_000_000
_CARVED_FROM = 2.0
_CARVED_STEP = 0.7


@dataclass(frozen=True, eq=False, slots=True)
class Field:
    """A grid about a scan.

    Attributes:
        origin: (3,) mm, corner of the first cell.
        cell_mm: edge of a cell.
        nearest: (X, Y, Z) number of the sample's point that is nearest to a cell.
        is_empty: (X, Y, Z) where the camera saw through.
        sample: the points.
    """

    origin: Vector3
    cell_mm: float
    nearest: NDArray[np.int32]
    is_empty: NDArray[np.bool_]
    sample: Sample

    @classmethod
    def around(cls, sample: Sample, cell_mm: float, margin_mm: float) -> Self:
        low = sample.points.min(axis=0) - margin_mm
        span = sample.points.max(axis=0) + margin_mm - low
        cell_mm = max(cell_mm, float(np.cbrt(np.prod(span) / _MOST_CELLS)))
        shape = np.ceil(span / cell_mm).astype(int) + 1
        where = tuple(((sample.points - low) / cell_mm).astype(int).T)
        number = np.full(shape, -1, np.int32)
        number[where] = np.arange(len(sample), dtype=np.int32)
        indices = distance_transform_edt(number < 0, return_distances=False, return_indices=True)
        nearest = np.asarray(number[tuple(indices)], np.int32)
        return cls(low, cell_mm, nearest, _seen_through(sample, low, cell_mm, number >= 0), sample)

    def near(self, points: Points) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
        """Numbers of the points near places (..., 3), and whether each place was seen through.

        Outside the grid the number is -1.
        """
        place = ((points - self.origin) / self.cell_mm).astype(np.int32)
        is_inside = np.all((points >= self.origin) & (place < self.nearest.shape), axis=-1)
        place[~is_inside] = 0
        x, y, z = np.moveaxis(place, -1, 0)
        flat = (x * self.nearest.shape[1] + y) * self.nearest.shape[2] + z
        number = np.where(is_inside, self.nearest.ravel()[flat], -1)
        return number, is_inside & self.is_empty.ravel()[flat]

    def agreement(self, points: Points, normals: Points, reach_mm: float) -> tuple[Floats, Floats]:
        """For H placements of M points (H, M, 3): the share on this surface, and the share seen through."""
        number, is_carved = self.near(points)
        at = np.maximum(number, 0)
        apart = np.linalg.norm(points - self.sample.points[at], axis=-1)
        alike = np.einsum("hmi,hmi->hm", normals, self.sample.normals[at]) > 0.7
        return (
            np.mean((number >= 0) & (apart < reach_mm) & alike, axis=1),
            np.mean(is_carved & (apart > reach_mm), axis=1),
        )


def _seen_through(
    sample: Sample, low: Vector3, cell_mm: float, is_taken: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """(X, Y, Z) cells on the way from points to the camera, and not beside the surface."""
    shape = np.array(is_taken.shape)
    is_empty = np.zeros(is_taken.shape, np.bool_)
    sees = np.flatnonzero(np.any(sample.towards != 0.0, axis=1))
    farthest = float(np.linalg.norm(shape)) * cell_mm
    for away in np.arange(_CARVED_FROM * cell_mm, farthest, _CARVED_STEP * cell_mm):
        place = ((sample.points[sees] + away * sample.towards[sees] - low) / cell_mm).astype(int)
        is_inside = np.all((place >= 0) & (place < shape), axis=1)
        # The grid is a box: a ray that has left it does not come back.
        sees, place = sees[is_inside], place[is_inside]
        if not len(sees):
            break
        is_empty[tuple(place.T)] = True
    return is_empty & ~binary_dilation(is_taken, iterations=2)
