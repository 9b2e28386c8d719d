"""How far two clouds in one frame lie from each other."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from app.errors import PointCloudFileError
from app.geometry.arrays import Floats, Points
from app.surface.ply_reader import PlyFile

_MOST_POINTS = 500_000
_MOST_QUESTIONS = 50_000


@dataclass(frozen=True, slots=True)
class Distances:
    """From points of one cloud to the nearest of another, millimetres.

    Attributes:
        asked: points whose distance was looked for, an even choice of their cloud.
        median_mm, rms_mm, p95_mm: of their distances.
    """

    asked: int
    median_mm: float
    rms_mm: float
    p95_mm: float


@dataclass(frozen=True, slots=True)
class Deviation:
    """Two clouds, each measured against the other.

    Attributes:
        there: from the first cloud to the second.
        back: from the second cloud to the first.
        spacing_mm: median distance of neighbours within one of them, whichever is coarser: two scans of one
            surface differ by about that much, because their points lie beside each other.
    """

    there: Distances
    back: Distances
    spacing_mm: float


def deviation(first: Path, second: Path) -> Deviation:
    """Distances between two clouds in one frame; of large ones an even choice of points is taken.

    Raises:
        PointCloudFileError: one of them cannot be read, or is empty.
    """
    clouds = [_chosen(path) for path in (first, second)]
    trees = [cKDTree(points) for points in clouds]
    spacing = max(_spacing(points, tree) for points, tree in zip(clouds, trees, strict=True))
    return Deviation(_distances(clouds[0], trees[1]), _distances(clouds[1], trees[0]), spacing)


def _chosen(path: Path) -> Points:
    """Every k-th point (N, 3), read piece by piece."""
    file = PlyFile.open(path)
    step = -(-file.points // _MOST_POINTS) or 1
    kept, done = [], 0
    for piece in file.pieces():
        kept.append(piece.points[-done % step :: step].astype(np.float64))
        done += len(piece)
    if not done:
        raise PointCloudFileError(str(path), "has no points")
    return np.concatenate(kept)


def _asked(points: Points) -> Points:
    return points[:: -(-len(points) // _MOST_QUESTIONS)]


def _distances(points: Points, tree: cKDTree) -> Distances:
    asked = _asked(points)
    found: Floats = np.asarray(tree.query(asked)[0])
    return Distances(
        len(asked),
        float(np.median(found)),
        float(np.sqrt(np.mean(found**2))),
        float(np.quantile(found, 0.95)),
    )


def _spacing(points: Points, tree: cKDTree) -> float:
    if len(points) < 2:
        return 0.0
    return float(np.median(np.asarray(tree.query(_asked(points), 2)[0])[:, 1]))
