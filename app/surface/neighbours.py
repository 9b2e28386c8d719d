"""Which points lie near which, for large clouds and with bounded memory."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from app.errors import SurfaceError
from app.geometry.arrays import Floats, Points, Vector3

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

MOST_POINTS = 20_000_000
"""More are refused: a tree of them and their neighbours would not fit into a usual machine's memory."""

# Neighbours that are held at once: about 100 MB of distances and numbers.
_AT_ONCE = 4_000_000
_BITS = 21
_CLIP = 50.0
_SAMPLE = 10_000


@dataclass(frozen=True, eq=False, slots=True)
class Places:
    """The distinct places at which points lie, neighbours side by side in memory.

    A search among many copies of one point would compare each with each; among places it does not.

    Attributes:
        points: (M, 3) mm.
        first: (M,) for each place, one of the points that were given.
        of_point: (N,) for each point that was given, its place.
        tree: of the places.
    """

    points: Points
    first: NDArray[np.intp]
    of_point: NDArray[np.intp]
    tree: "cKDTree"

    def __len__(self) -> int:
        return len(self.points)

    @classmethod
    def of(cls, points: NDArray[Any]) -> Self:
        """Of points (N, 3) mm, all finite.

        Raises:
            SurfaceError: there are too many.
        """
        if len(points) > MOST_POINTS:
            raise SurfaceError(
                f"{len(points):,} points are too many to look for neighbours; {MOST_POINTS:,} is the most.",
                "Thin the cloud first, with the step thin.",
            )
        # SciPy takes a third of a second to load, which the server's start can do without.
        from scipy.spatial import cKDTree

        order = np.argsort(_along_curve(points), kind="stable")
        ordered = points[order].astype(np.float64)
        is_new = np.ones(len(points), np.bool_)
        is_new[1:] = np.any(ordered[1:] != ordered[:-1], axis=1)
        of_point = np.empty(len(points), np.intp)
        of_point[order] = np.cumsum(is_new) - 1
        distinct = ordered if is_new.all() else ordered[is_new]
        return cls(distinct, order[is_new], of_point, cKDTree(distinct, balanced_tree=False))

    def nearest(
        self, count: int, asked: Points | None = None, within_mm: float = np.inf
    ) -> Iterator[tuple[slice, Floats, NDArray[np.intp]]]:
        """The nearest places, piece by piece: which were asked for, distances and numbers (n, count).

        A place is its own nearest neighbour, at distance zero. Where there are fewer, the distance is
        infinite and the number that of the last place.

        Args:
            count: of neighbours.
            asked: (K, 3) mm; the places themselves where absent.
            within_mm: how far to look.
        """
        asked = self.points if asked is None else asked
        step = max(1, _AT_ONCE // count)
        for start in range(0, len(asked), step):
            part = slice(start, min(start + step, len(asked)))
            distances, numbers = self.tree.query(
                asked[part], k=np.arange(1, count + 1), distance_upper_bound=within_mm, workers=-1
            )
            yield part, np.asarray(distances), np.minimum(np.asarray(numbers), max(len(self) - 1, 0))

    def spacing_mm(self) -> float:
        """The usual distance between a place and the one nearest to it; 0 for a single place."""
        if len(self) < 2:
            return 0.0
        asked = self.points[:: -(-len(self) // _SAMPLE)]
        distances, _ = self.tree.query(asked, k=np.array([2]), workers=-1)
        return float(np.median(distances))


def is_finite(points: NDArray[Any]) -> NDArray[np.bool_]:
    """(N,) which of points (N, 3) lie anywhere."""
    return np.asarray(np.isfinite(points).all(axis=1), np.bool_)


def cell_keys(points: NDArray[Any], size_mm: float) -> NDArray[np.int64]:
    """(N,) one number for each cell of that size; points in one cell have the same.

    Raises:
        SurfaceError: the points span more than two million cells along an axis.
    """
    if not len(points):
        return np.zeros(0, np.int64)
    low = points.min(axis=0).astype(np.float64)
    if float((points.max(axis=0) - low).max()) / size_mm >= 1 << _BITS:
        raise SurfaceError(
            f"Cells of {size_mm:g} mm are too small for points so far apart.",
            "Remove what lies far away first, or take larger cells.",
        )
    keys = np.zeros(len(points), np.int64)
    for axis in range(3):
        keys <<= _BITS
        keys |= ((points[:, axis] - low[axis]) / size_mm).astype(np.int64)
    return keys


def surroundings(points: NDArray[Any]) -> tuple[Vector3, float]:
    """The middle (3,) of points (N, 3), and how far around it all are but a few far away, mm."""
    sample = points[:: -(-len(points) // _SAMPLE)].astype(np.float64)
    middle = np.median(sample, axis=0)
    return middle, _CLIP * max(float(np.median(np.abs(sample - middle).max(axis=1))), 1e-6)


def _along_curve(points: NDArray[Any]) -> NDArray[np.int64]:
    """(N,) position on a curve through all of space that keeps neighbours together (Morton's order)."""
    if not len(points):
        return np.zeros(0, np.int64)
    # A few points far away must not put all others into one cell.
    middle, reach = surroundings(points)
    code = np.zeros(len(points), np.int64)
    for axis in range(3):
        level = np.clip((points[:, axis] - middle[axis]) / (2.0 * reach) + 0.5, 0.0, 1.0)
        code |= _spread((level * ((1 << _BITS) - 1)).astype(np.int64)) << axis
    return code


def _spread(bits: NDArray[np.int64]) -> NDArray[np.int64]:
    """Two empty bits after each of 21."""
    for shift, mask in (
        (32, 0x1F00000000FFFF), (16, 0x1F0000FF0000FF), (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3), (2, 0x1249249249249249),
    ):  # fmt: skip
        bits = (bits | (bits << shift)) & mask
    return bits
