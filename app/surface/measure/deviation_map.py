"""Where a thing differs from what it should be: a distance for each point, as colours and in numbers."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.errors import SurfaceError
from app.geometry.arrays import Floats
from app.geometry.cloud import PointCloud
from app.geometry.mesh import TriangleMesh
from app.surface.measure.thing import Thing, points_of
from app.surface.neighbours import is_finite
from app.surface.signed_distance import distances_to_cloud, distances_to_mesh

_BINS = 61
# Colours run to this quantile of the distances, so that a few stray points do not pale all others.
_SCALE_QUANTILE = 0.95
_LEAST_SCALE_MM = 0.01
_STOPS = np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
_COLOURS = np.array([[33, 68, 160], [104, 172, 226], [236, 236, 230], [240, 156, 84], [176, 32, 32]])


@dataclass(frozen=True, eq=False, slots=True)
class DeviationMap:
    """Distances of a thing's points from another thing.

    Attributes:
        cloud: the points, coloured: blue inside, pale where they agree, red outside.
        distances_mm: (N,) of each, positive outside where `has_sign`.
        has_sign: whether the other thing tells its inside from its outside.
        scale_mm: distance at which the colours end.
        edges_mm, counts: (B + 1,), (B,) histogram between minus scale and scale; what lies beyond is in the
            first and last.
    """

    cloud: PointCloud
    distances_mm: Floats
    has_sign: bool
    scale_mm: float
    edges_mm: Floats
    counts: NDArray[np.intp]

    def as_json(self) -> dict[str, Any]:
        """The numbers, without the points."""
        found, away = self.distances_mm, np.abs(self.distances_mm)
        return {
            "points": len(found),
            "signed": self.has_sign,
            "mean_mm": float(found.mean()),
            "median_mm": float(np.median(found)),
            "median_away_mm": float(np.median(away)),
            "rms_mm": float(np.sqrt(np.mean(found**2))),
            "p95_mm": float(np.quantile(away, 0.95)),
            "largest_mm": float(away.max()),
            "scale_mm": self.scale_mm,
            "histogram": {"edges_mm": self.edges_mm.tolist(), "counts": self.counts.tolist()},
        }


def deviation_map(thing: Thing, against: Thing, scale_mm: float | None = None) -> DeviationMap:
    """Compare two things that lie in one frame.

    Args:
        thing: a cloud, or a mesh, whose corners are taken.
        against: what it is compared with.
        scale_mm: distance at which the colours end; by the distances themselves where absent.

    Raises:
        SurfaceError: one of them is empty, or too large.
    """
    cloud = points_of(thing)
    cloud = cloud.select(is_finite(cloud.points))
    if not len(cloud):
        raise SurfaceError("There are no points to measure.")
    if isinstance(against, TriangleMesh):
        found, has_sign = distances_to_mesh(cloud.points, against), True
    else:
        found, has_sign = distances_to_cloud(cloud.points, against)
    if scale_mm is None:
        scale_mm = max(_rounded_up(float(np.quantile(np.abs(found), _SCALE_QUANTILE))), _LEAST_SCALE_MM)
    edges = np.linspace(-scale_mm if has_sign else 0.0, scale_mm, _BINS + 1)
    counts, _ = np.histogram(np.clip(found, edges[0], edges[-1]), edges)
    return DeviationMap(
        replace(cloud, colours=deviation_colours(found, scale_mm)), found, has_sign, scale_mm, edges,
        counts.astype(np.intp),
    )  # fmt: skip


def deviation_colours(distances_mm: Floats, scale_mm: float) -> NDArray[np.uint8]:
    """(N, 3) red, green, blue: blue inside, red outside, pale between."""
    level = np.clip(distances_mm / scale_mm, -1.0, 1.0)
    channels = [np.interp(level, _STOPS, _COLOURS[:, channel]) for channel in range(3)]
    colours: NDArray[np.uint8] = np.rint(np.stack(channels, axis=1)).astype(np.uint8)
    return colours


def _rounded_up(value: float) -> float:
    """To 1, 2 or 5 times a power of ten."""
    if not value > 0.0:
        return 0.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= 0.9999 * value))
