"""Plane, sphere and cylinder through the majority of points, and how well they fit."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from app.errors import SurfaceError
from app.geometry.arrays import Floats, Points, Vector3
from app.surface.neighbours import Places, is_finite
from app.surface.normals import least_spread

FitKind: TypeAlias = Literal["plane", "sphere", "cylinder"]

_MAD_TO_SIGMA = 1.4826
_TUKEY = 4.685
_ROUNDS = 30
_TRIES = 400
_SAMPLE = 3_000
_MOST_POINTS = 200_000
_FEWEST = 10
_SMALL = 1e-9
_LARGEST_MM = 1e5


@dataclass(frozen=True, eq=False, slots=True)
class Fit:
    """A shape through points.

    Attributes:
        kind: which shape.
        centre_mm: (3,) of a sphere; of a plane, the middle of its points; of a cylinder, the point of its
            axis in the middle of its points.
        direction: (3,) unit vector: a plane's normal or a cylinder's axis, not downwards; zeros for a sphere.
        radius_mm: of sphere and cylinder; NaN for a plane.
        rms_mm: residual of the points that were used.
        robust_mm: standard deviation of the middle of ALL residuals, which outliers do not move.
        used, given: how many points the shape goes through, and how many there were.
        residuals: (given,) mm, positive outside, or above a plane.
    """

    kind: FitKind
    centre_mm: Vector3
    direction: Vector3
    radius_mm: float
    rms_mm: float
    robust_mm: float
    used: int
    given: int
    residuals: Floats

    def as_json(self) -> dict[str, Any]:
        """Everything but the residuals."""
        has_direction, has_radius = self.kind != "sphere", self.kind != "plane"
        return {
            "kind": self.kind,
            "centre_mm": self.centre_mm.tolist(),
            "direction": self.direction.tolist() if has_direction else None,
            "radius_mm": self.radius_mm if has_radius else None,
            "diameter_mm": 2.0 * self.radius_mm if has_radius else None,
            "rms_mm": self.rms_mm,
            "robust_mm": self.robust_mm,
            "used": self.used,
            "given": self.given,
        }


def fit(kind: FitKind, points: NDArray[Any], seed: int = 0) -> Fit:
    """The shape that most of the points lie on; up to about half of them may lie elsewhere.

    Random few points give a first shape; weighted least squares, in which points count the less the further
    away they lie (Tukey), make it exact. Of many points an even choice of 200,000 decides.

    Args:
        points: (N, 3) mm; those that are not finite are left out.
        seed: of the random choice.

    Raises:
        SurfaceError: there are too few points, or they determine no such shape.
    """
    given = points[is_finite(points)].astype(np.float64)
    if len(given) < _FEWEST:
        raise SurfaceError(f"{len(given)} points are too few to fit a {kind}; it needs {_FEWEST}.")
    middle = np.median(given, axis=0)
    chosen = given[:: -(-len(given) // _MOST_POINTS)] - middle
    if float(np.ptp(chosen, axis=0).max()) < _SMALL:
        raise SurfaceError(f"All points lie in one place; no {kind} goes through them.")
    start, distance, jacobian = _SHAPES[kind]
    found = _refined(chosen, start(chosen, np.random.default_rng(seed)), distance, jacobian)
    if found is None or not np.isfinite(found).all() or np.abs(found).max() > _LARGEST_MM:
        raise SurfaceError(
            f"The points do not determine a {kind}.", "Choose a part of them, or another shape."
        )
    residuals = distance(given - middle, found)
    return _fit_of(kind, found, residuals, given - middle, middle)


def _fit_of(kind: FitKind, found: Floats, residuals: Floats, points: Points, middle: Vector3) -> Fit:
    scale = _scale(residuals)
    used = np.abs(residuals) < _TUKEY * scale
    direction, radius = np.zeros(3), float("nan")
    centre = points[used].mean(axis=0) if used.any() else np.zeros(3)
    if kind == "sphere":
        centre, radius = found[:3], float(found[3])
    else:
        direction = found[:3] / np.linalg.norm(found[:3])
        if direction[np.argmax(np.abs(direction) > 1e-6) if abs(direction[2]) < 1e-6 else 2] < 0.0:
            direction = -direction
            residuals = -residuals if kind == "plane" else residuals
    if kind == "cylinder":
        centre = found[3:6] + ((centre - found[3:6]) @ direction) * direction
        radius = float(found[6])
    rms = float(np.sqrt(np.mean(residuals[used] ** 2))) if used.any() else 0.0
    return Fit(
        kind, centre + middle, direction, radius, rms, _scale(residuals), int(np.count_nonzero(used)),
        len(points), residuals,
    )  # fmt: skip


def _refined(
    points: Points,
    start: Floats | None,
    distance: Callable[[Points, Floats], Floats],
    jacobian: Callable[[Points, Floats], Floats],
) -> Floats | None:
    """Iterated weighted least squares from a first shape."""
    if start is None:
        return None
    found = start
    for _ in range(_ROUNDS):
        residual = distance(points, found)
        scaled = residual / (_TUKEY * _scale(residual))
        weights = np.where(np.abs(scaled) < 1.0, (1.0 - scaled**2) ** 2, 0.0)
        slope = jacobian(points, found)
        normal = (weights[:, None] * slope).T @ slope
        # Parameters that mean the same, such as the length of a direction, stay as they are.
        step = -np.linalg.pinv(normal, rcond=1e-10, hermitian=True) @ (slope.T @ (weights * residual))
        found = found + step
        if np.abs(step).max() < 1e-9:
            break
    return found


def _scale(residuals: Floats) -> float:
    """Standard deviation by the median, mm; never zero."""
    return max(_MAD_TO_SIGMA * float(np.median(np.abs(residuals))), _SMALL)


def _best(
    candidates: list[Floats], points: Points, distance: Callable[[Points, Floats], Floats]
) -> Floats | None:
    """The shape whose median distance to the points is least."""
    medians = [float(np.median(np.abs(distance(points, each)))) for each in candidates]
    return candidates[int(np.argmin(medians))] if candidates else None


def _chosen(points: Points, rng: np.random.Generator) -> Points:
    return points if len(points) <= _SAMPLE else points[rng.choice(len(points), _SAMPLE, replace=False)]


def _plane_start(points: Points, rng: np.random.Generator) -> Floats | None:
    sample = _chosen(points, rng)
    a, b, c = sample[rng.integers(0, len(sample), (3, _TRIES))]
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    is_good = lengths > 1e-9 * max(float(np.ptp(sample, axis=0).max()) ** 2, 1.0)
    normals, at = normals[is_good] / lengths[is_good, None], a[is_good]
    return _best([np.append(n, n @ p) for n, p in zip(normals, at, strict=True)], sample, _plane_distance)


def _plane_distance(points: Points, plane: Floats) -> Floats:
    """`plane` is a normal of any length and, in its units, the distance from the origin."""
    distances: Floats = (points @ plane[:3] - plane[3]) / np.linalg.norm(plane[:3])
    return distances


def _plane_slope(points: Points, plane: Floats) -> Floats:
    length = np.linalg.norm(plane[:3])
    normal, away = plane[:3] / length, _plane_distance(points, plane)
    return np.column_stack([(points - away[:, None] * normal) / length, np.full(len(points), -1.0 / length)])


def _sphere_start(points: Points, rng: np.random.Generator) -> Floats | None:
    sample = _chosen(points, rng)
    four = sample[rng.integers(0, len(sample), (_TRIES, 4))]
    matrix = 2.0 * (four[:, 1:] - four[:, :1])
    right = np.sum(four[:, 1:] ** 2 - four[:, :1] ** 2, axis=2)
    is_good = np.abs(np.linalg.det(matrix)) > 1e-9 * max(float(np.ptp(sample, axis=0).max()) ** 3, 1e-9)
    centres = np.linalg.solve(matrix[is_good], right[is_good][..., None])[..., 0]
    radii = np.linalg.norm(centres - four[is_good, 0], axis=1)
    return _best(list(np.column_stack([centres, radii])), sample, _sphere_distance)


def _sphere_distance(points: Points, sphere: Floats) -> Floats:
    distances: Floats = np.linalg.norm(points - sphere[:3], axis=1) - sphere[3]
    return distances


def _sphere_slope(points: Points, sphere: Floats) -> Floats:
    apart = sphere[:3] - points
    away = np.maximum(np.linalg.norm(apart, axis=1, keepdims=True), _SMALL)
    return np.column_stack([apart / away, np.full(len(points), -1.0)])


def _cylinder_start(points: Points, rng: np.random.Generator) -> Floats | None:
    """Two points whose normals cross the axis give its direction; a circle through three its place."""
    dense = (
        points
        if len(points) <= 10 * _SAMPLE
        else points[rng.choice(len(points), 10 * _SAMPLE, replace=False)]
    )
    places = Places.of(dense)
    normals = least_spread(places, 16).astype(np.float64)
    known = np.flatnonzero(np.any(normals != 0.0, axis=1))
    if len(known) < _FEWEST:
        return None
    sample = _chosen(points, rng)
    candidates = []
    for one, other in known[rng.integers(0, len(known), (_TRIES, 2))]:
        axis = np.cross(normals[one], normals[other])
        length = np.linalg.norm(axis)
        if length < 0.2:
            continue
        axis /= length
        # Where the two normals meet, seen along the axis.
        across = np.cross(axis, normals[one])
        slope = normals[other] @ across
        if abs(slope) < 1e-3:
            continue
        apart = places.points[one] - places.points[other]
        centre = places.points[other] + (apart @ across) / slope * normals[other]
        centre -= (centre @ axis) * axis
        candidate = np.concatenate([axis, centre, [0.0]])
        candidate[6] = float(np.median(_cylinder_distance(sample, candidate)))
        candidates.append(candidate)
    return _best(candidates, sample, _cylinder_distance)


def _cylinder_distance(points: Points, cylinder: Floats) -> Floats:
    """`cylinder` is an axis of any length, a point on it, and the radius."""
    axis = cylinder[:3] / np.linalg.norm(cylinder[:3])
    apart = points - cylinder[3:6]
    distances: Floats = np.linalg.norm(apart - (apart @ axis)[:, None] * axis, axis=1) - cylinder[6]
    return distances


def _cylinder_slope(points: Points, cylinder: Floats) -> Floats:
    length = np.linalg.norm(cylinder[:3])
    axis = cylinder[:3] / length
    apart = points - cylinder[3:6]
    along = apart @ axis
    outward = apart - along[:, None] * axis
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), _SMALL)
    return np.column_stack([-along[:, None] * outward / length, -outward, np.full(len(points), -1.0)])


_SHAPES: dict[FitKind, tuple[Any, Callable[[Points, Floats], Floats], Callable[[Points, Floats], Floats]]] = {
    "plane": (_plane_start, _plane_distance, _plane_slope),
    "sphere": (_sphere_start, _sphere_distance, _sphere_slope),
    "cylinder": (_cylinder_start, _cylinder_distance, _cylinder_slope),
}
