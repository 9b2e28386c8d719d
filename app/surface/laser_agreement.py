"""Where two lasers saw one surface in different places, and which constant shift explains it."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats, Vector3
from app.geometry.cloud import PointCloud
from app.surface.neighbours import Places

_NEIGHBOURS = 6
_MAD_TO_SIGMA = 1.4826
_TUKEY = 4.685
_ROUNDS = 6
_SAME_FACING = 0.7
_FEWEST = 50
# A shift explains a disagreement when no more than this share of its systematic part is left.
_LEFT = 0.5


@dataclass(frozen=True, eq=False, slots=True)
class LaserFinding:
    """How far a second laser's points lie from the surface that a first one saw.

    Attributes:
        first, second: names of the lasers.
        pairs: points of the second that lie on a surface of the first.
        share: of the second laser's points, 0..1.
        median_mm: median of the distances along the normal, whichever way.
        offset_mm: median with its sign; positive where the second lies outside.
        shift_mm: (3,) constant error of the second against the first, in the frame of the camera's stand: the
            table frame as it lies at angle 0. An error of a laser's plane shows as such a shift.
        median_after_mm: of the distances once the shift is taken away.
    """

    first: str
    second: str
    pairs: int
    share: float
    median_mm: float
    offset_mm: float
    shift_mm: Vector3
    median_after_mm: float

    @property
    def is_explained(self) -> bool:
        """Whether the constant shift leaves hardly more than noise of a disagreement that is real."""
        return self.median_after_mm < (1.0 - _LEFT) * self.median_mm


@dataclass(frozen=True, eq=False, slots=True)
class LaserMap:
    """Every pair of lasers, and the disagreement at each point.

    Attributes:
        findings: of the pairs that overlap.
        distance_mm: (N,) from each point to the surface of another laser, along the normal, the largest of
            several; NaN where no other laser saw it.
        partner: (N,) one of the other laser's points there; -1 where there is none.
        shifts: for each laser by its number, the shift (3,) that brings all together, half of the
            difference to each of two, in the frame of the camera's stand.
    """

    findings: tuple[LaserFinding, ...]
    distance_mm: Floats
    partner: NDArray[np.intp]
    shifts: dict[int, Vector3]


def map_lasers(cloud: PointCloud, within_mm: float = 2.0) -> LaserMap:
    """Compare every two lasers of a cloud with normals.

    Args:
        within_mm: surfaces further apart than this are taken for different ones.

    Raises:
        SurfaceError: there are too many points.
    """
    distance = np.full(len(cloud), np.nan)
    partner = np.full(len(cloud), -1, np.intp)
    usable = np.isfinite(cloud.points).all(axis=1) & np.any(cloud.normals != 0.0, axis=1)
    members = {
        laser: np.flatnonzero(usable & (cloud.laser == laser)) for laser in np.unique(cloud.laser[usable])
    }
    places = {
        laser: Places.of(cloud.points[those]) for laser, those in members.items() if len(those) >= _FEWEST
    }
    findings, equations, wanted = [], [], []
    for one, other in combinations(sorted(places), 2):
        there = _heights(cloud, places[one], members[one], members[other], within_mm)
        back = _heights(cloud, places[other], members[other], members[one], within_mm)
        for found in (there, back):
            is_worse = ~(np.abs(distance[found.asked]) >= np.abs(found.height))
            which = found.asked[is_worse]
            distance[which], partner[which] = found.height[is_worse], found.partner[is_worse]
        if len(there.asked) + len(back.asked) < _FEWEST:
            continue
        # Seen from the first laser, a point of the first that lies outside the second's surface is the
        # second lying inside.
        heights = np.concatenate([there.height, -back.height])
        asked = np.concatenate([there.asked, back.asked])
        normals = _at_the_stand(cloud.normals[asked].astype(np.float64), cloud.angle_deg[asked])
        shift = _shift(normals, heights)
        findings.append(
            LaserFinding(
                _name(cloud, one), _name(cloud, other), len(there.asked),
                len(there.asked) / len(members[other]), float(np.median(np.abs(heights))),
                float(np.median(heights)), shift, float(np.median(np.abs(heights - normals @ shift))),
            )
        )  # fmt: skip
        if findings[-1].is_explained:
            equations.append((one, other))
            wanted.append(shift)
    return LaserMap(tuple(findings), distance, partner, _shared(equations, wanted))


def moved_together(cloud: PointCloud, shifts: dict[int, Vector3]) -> NDArray[np.float32]:
    """The points (N, 3) with each laser's constant error taken away."""
    points = cloud.points.astype(np.float64)
    for laser, shift in shifts.items():
        those = np.flatnonzero(cloud.laser == laser)
        points[those] -= _onto_the_table(np.tile(shift, (len(those), 1)), cloud.angle_deg[those])
    return points.astype(np.float32)


@dataclass(frozen=True, eq=False, slots=True)
class _Heights:
    """Of asked points (K,) above another laser's surface (K,) mm, and one of that laser's points there."""

    asked: NDArray[np.intp]
    height: Floats
    partner: NDArray[np.intp]


def _heights(
    cloud: PointCloud,
    surface: Places,
    of_surface: NDArray[np.intp],
    asked: NDArray[np.intp],
    within_mm: float,
) -> _Heights:
    """How far points lie above another laser's surface.

    Along the mean of both normals: seen along one of them, a round surface would bulge.
    """
    chosen, heights, partners = [], [], []
    points, normals = cloud.points.astype(np.float64), cloud.normals.astype(np.float64)
    count = min(_NEIGHBOURS, len(surface))
    # Neighbours that lie beside count as long as they surround the point; the gap itself is only within_mm.
    for part, distances, numbers in surface.nearest(count, points[asked], 2.0 * within_mm):
        which = asked[part]
        near = of_surface[surface.first[numbers]]
        apart = points[which][:, None] - surface.points[numbers]
        between = (normals[which][:, None] + normals[near]) / 2.0
        height = np.einsum("nki,nki->nk", apart, between)
        agree = np.einsum("ni,nki->nk", normals[which], normals[near])
        middle = apart.mean(axis=1)
        sideways = middle - np.einsum("ni,ni->n", middle, normals[which])[:, None] * normals[which]
        spread = np.linalg.norm(apart - middle[:, None], axis=2).max(axis=1)
        keep = (
            np.isfinite(distances).all(axis=1) & (agree.min(axis=1) > _SAME_FACING)
            & (np.linalg.norm(sideways, axis=1) < 0.7 * spread)
        )  # fmt: skip
        mean = height.mean(axis=1)
        keep &= np.abs(mean) <= within_mm
        chosen.append(which[keep])
        heights.append(mean[keep])
        partners.append(near[keep, 0])
    return _Heights(
        np.concatenate(chosen or [np.zeros(0, np.intp)]), np.concatenate(heights or [np.zeros(0)]),
        np.concatenate(partners or [np.zeros(0, np.intp)]),
    )  # fmt: skip


def _shift(normals: Floats, heights: Floats) -> Vector3:
    """(3,) the robust least-squares shift s with normals @ s = heights; zero where no surface holds it."""
    shift = np.zeros(3)
    for _ in range(_ROUNDS):
        residual = heights - normals @ shift
        scaled = residual / (_TUKEY * max(_MAD_TO_SIGMA * float(np.median(np.abs(residual))), 1e-6))
        weights = np.where(np.abs(scaled) < 1.0, (1.0 - scaled**2) ** 2, 0.0)
        values, vectors = np.linalg.eigh((weights[:, None] * normals).T @ normals)
        is_held = values > 0.02 * values.sum()
        inverse = (vectors[:, is_held] / values[is_held]) @ vectors[:, is_held].T
        shift = inverse @ (normals.T @ (weights * heights))
    return shift


def _shared(pairs: list[tuple[int, int]], shifts: list[Vector3]) -> dict[int, Vector3]:
    """Each laser's own error, so that the differences come out and their mean is zero."""
    lasers = sorted({laser for pair in pairs for laser in pair})
    if not lasers:
        return {}
    matrix = np.zeros((len(pairs) + 1, len(lasers)))
    for row, (one, other) in enumerate(pairs):
        matrix[row, lasers.index(other)], matrix[row, lasers.index(one)] = 1.0, -1.0
    matrix[-1] = 1.0
    own, *_ = np.linalg.lstsq(matrix, np.vstack([*shifts, np.zeros(3)]), rcond=None)
    return dict(zip(lasers, own, strict=True))


def _at_the_stand(vectors: Floats, angle_deg: NDArray[np.float32]) -> Floats:
    """Vectors (N, 3) of the table frame as they lay in the room when they were seen."""
    return _turned(vectors, np.radians(angle_deg.astype(np.float64)))


def _onto_the_table(vectors: Floats, angle_deg: NDArray[np.float32]) -> Floats:
    """Vectors (N, 3) in the room as they lie on the table."""
    return _turned(vectors, -np.radians(angle_deg.astype(np.float64)))


def _turned(vectors: Floats, angle_rad: Floats) -> Floats:
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    x, y, z = vectors.T
    return np.column_stack([cosine * x - sine * y, sine * x + cosine * y, z])


def _name(cloud: PointCloud, laser: int) -> str:
    return cloud.laser_names[laser] if laser < len(cloud.laser_names) else f"laser {laser}"
