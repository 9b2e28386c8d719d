"""How far two clouds in one frame lie from each other."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from app.errors import PointCloudFileError
from app.surface.neighbours import Places, is_finite
from app.surface.thinning import read_thinned

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
    clouds = [_places(path) for path in (first, second)]
    spacing = max(places.spacing_mm() for places in clouds)
    return Deviation(_distances(clouds[0], clouds[1]), _distances(clouds[1], clouds[0]), spacing)


def _places(path: Path) -> Places:
    points = read_thinned(path, _MOST_POINTS).cloud.points
    points = points[is_finite(points)]
    if not len(points):
        raise PointCloudFileError(str(path), "has no points")
    return Places.of(points)


def _distances(places: Places, others: Places) -> Distances:
    asked = places.points[:: -(-len(places) // _MOST_QUESTIONS)]
    found = np.concatenate([distances[:, 0] for _, distances, _ in others.nearest(1, asked)])
    return Distances(
        len(asked),
        float(np.median(found)),
        float(np.sqrt(np.mean(found**2))),
        float(np.quantile(found, 0.95)),
    )
