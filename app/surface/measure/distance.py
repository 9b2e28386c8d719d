"""The distance between two places on a thing."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.errors import SurfaceError
from app.geometry.arrays import Floats, Vector3
from app.surface.neighbours import is_finite

_AROUND_MM = 0.5


@dataclass(frozen=True, eq=False, slots=True)
class Span:
    """Straight from one place to another.

    Attributes:
        start_mm, end_mm: (3,) the measured places that lie nearest to those that were asked for.
        distance_mm: between them.
        moved_mm: how far each lies from where it was asked for.
    """

    start_mm: Vector3
    end_mm: Vector3
    distance_mm: float
    moved_mm: tuple[float, float]

    def as_json(self) -> dict[str, Any]:
        return {
            "start_mm": self.start_mm.tolist(),
            "end_mm": self.end_mm.tolist(),
            "distance_mm": self.distance_mm,
            "moved_mm": list(self.moved_mm),
        }


def span_between(points: NDArray[Any], start: Vector3, end: Vector3) -> Span:
    """Between the places nearest to two points.

    A place is the middle of the points within half a millimetre of the nearest one, so that the noise of
    a single point counts less.

    Args:
        points: (N, 3) mm.

    Raises:
        SurfaceError: there are no points.
    """
    known = points[is_finite(points)].astype(np.float64)
    if not len(known):
        raise SurfaceError("There are no points to measure.")
    first, last = (_place(known, np.asarray(wanted, np.float64)) for wanted in (start, end))
    return Span(
        first, last, float(np.linalg.norm(last - first)),
        (float(np.linalg.norm(first - start)), float(np.linalg.norm(last - end))),
    )  # fmt: skip


def _place(points: Floats, wanted: Vector3) -> Vector3:
    nearest = points[np.argmin(np.sum((points - wanted) ** 2, axis=1))]
    around = np.sum((points - nearest) ** 2, axis=1) <= _AROUND_MM**2
    middle: Vector3 = points[around].mean(axis=0)
    return middle
