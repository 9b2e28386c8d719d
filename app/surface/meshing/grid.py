"""A regular grid around points, and values put on it and read from it."""

import math
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len
from scipy.ndimage import map_coordinates

from app.geometry.arrays import Floats, Points, Vector3

# Points whose corners are held at once.
_AT_ONCE = 1_000_000


@dataclass(frozen=True, eq=False, slots=True)
class Grid:
    """Cells of one size; a value stands at the lowest corner of its cell.

    Attributes:
        origin: (3,) mm, where the first value stands.
        cell_mm: distance of neighbours.
        shape: values along x, y and z; sizes that a Fourier transform likes.
    """

    origin: Vector3
    cell_mm: float
    shape: tuple[int, int, int]

    @classmethod
    def around(cls, points: Points, cell_mm: float, margin: float = 0.25) -> "Grid":
        """A grid about points, with a margin on every side as a share of the largest extent."""
        low, high = points.min(axis=0), points.max(axis=0)
        room = margin * float((high - low).max()) + 4.0 * cell_mm
        sizes = [
            next_fast_len(math.ceil((extent + 2.0 * room) / cell_mm), real=True) for extent in high - low
        ]
        middle = (low + high) / 2.0
        shape = (sizes[0], sizes[1], sizes[2])
        return cls(middle - 0.5 * cell_mm * (np.array(shape) - 1.0), cell_mm, shape)

    @property
    def cells(self) -> int:
        return math.prod(self.shape)

    def places(self, points: Points) -> Floats:
        """(N, 3) where points lie, counted in cells."""
        return (points - self.origin) / self.cell_mm

    def splat(self, points: Points, values: Floats) -> NDArray[np.float32]:
        """Values spread over the eight places around each point, by how near they are.

        Args:
            points: (N, 3) mm, all within the grid.
            values: (N, K) of each point, spread into K fields.

        Returns:
            (K, ...) one field for each column.
        """
        total = np.zeros((values.shape[1], self.cells), np.float32)
        for start in range(0, len(points), _AT_ONCE):
            part = slice(start, start + _AT_ONCE)
            places, shares = self._corners(points[part])
            for field, column in zip(total, values[part].T, strict=True):
                field += np.bincount(places.ravel(), (shares * column).ravel(), self.cells)
        return total.reshape(-1, *self.shape)

    def read(self, field: NDArray[np.float32], points: Points) -> Floats:
        """(N,) values of a field between its places, trilinear."""
        values = map_coordinates(field, self.places(points).T, order=1, mode="nearest")
        return np.asarray(values, np.float64)

    def _corners(self, points: Points) -> tuple[NDArray[np.int64], Floats]:
        """(8, N) flat numbers of the places around each point, and the share of each."""
        places = self.places(points)
        first = np.floor(places).astype(np.int64)
        part = places - first
        flat, shares = [], []
        for corner in product((0, 1), repeat=3):
            share = np.where(np.array(corner) == 1, part, 1.0 - part)
            shares.append(share[:, 0] * share[:, 1] * share[:, 2])
            flat.append(np.ravel_multi_index(tuple((first + corner).T), self.shape))
        return np.stack(flat), np.stack(shares)
