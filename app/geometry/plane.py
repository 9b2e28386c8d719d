"""The laser's sheet of light, and fitting a plane to points."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats, Points, Rays, Vector3

_ROBUST_ROUNDS = 12
# 1.4826 turns a median absolute deviation into the standard deviation of a normal distribution.
_MAD_TO_SIGMA = 1.4826
_TUKEY = 4.685


@dataclass(frozen=True, eq=False, slots=True)
class LaserPlane:
    """normal . X = distance_mm in the camera frame.

    Attributes:
        normal: (3,) unit vector with positive z.
        distance_mm: distance of the plane from the camera centre along the normal.
    """

    normal: Vector3
    distance_mm: float

    @classmethod
    def through(cls, point: Vector3, normal: Vector3) -> "LaserPlane":
        """The plane that holds a point, normal turned to positive z."""
        normal = np.asarray(normal, np.float64) / np.linalg.norm(normal)
        if normal[2] < 0.0:
            normal = -normal
        return cls(normal, float(normal @ point))

    def signed_distance(self, points: Points) -> Floats:
        """How far points (N, 3) lie in front of the plane, mm."""
        return points @ self.normal - self.distance_mm

    def intersect_rays(self, rays: Rays) -> Points:
        """Where rays (N, 3) from the camera centre meet the plane; NaN where they do not, or behind."""
        along = rays @ self.normal
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = self.distance_mm / along
        scale = np.where(np.isfinite(scale) & (scale > 0.0), scale, np.nan)
        return rays * scale[:, None]


@dataclass(frozen=True, eq=False, slots=True)
class PlaneFit:
    """A fitted plane and how well the points determine it.

    Attributes:
        plane: the plane.
        centroid: (3,) mean of the points that were used.
        residuals: (N,) signed distances of ALL given points, mm.
        is_inlier: (N,) which points were used.
        spread_mm: RMS extents of the points along their three principal directions, largest first; the
            last is the RMS residual, the middle one tells whether they span a plane or a mere line.
    """

    plane: LaserPlane
    centroid: Vector3
    residuals: Floats
    is_inlier: NDArray[np.bool_]
    spread_mm: Vector3

    @property
    def rms_mm(self) -> float:
        return float(np.sqrt(np.mean(self.residuals[self.is_inlier] ** 2)))


def fit_plane(points: Points) -> PlaneFit:
    """Least-squares plane by SVD: paper, equations 3 to 6.

    Args:
        points: (N, 3) with N >= 3, mm.

    Raises:
        ValueError: fewer than three points.
    """
    return _fit_weighted(points, np.ones(len(points)), np.ones(len(points), np.bool_))


def fit_plane_robust(points: Points, seed: int = 0) -> PlaneFit:
    """Plane through the majority: random triples (LMedS), then Tukey-weighted SVD.

    Args:
        points: (N, 3) with N >= 3, mm; up to half of them may be anywhere.
        seed: of the random triples.

    Raises:
        ValueError: fewer than three points, or all on one line.
    """
    if len(points) < 3:
        raise ValueError("a plane needs three points")
    rng = np.random.default_rng(seed)
    sample = points if len(points) <= 4000 else points[rng.choice(len(points), 4000, replace=False)]
    best: LaserPlane | None = None
    best_median = np.inf
    for _ in range(300):
        a, b, c = sample[rng.choice(len(sample), 3, replace=False)]
        normal = np.cross(b - a, c - a)
        length = np.linalg.norm(normal)
        if length <= 1e-9 * max(1.0, float(np.abs(sample).max()) ** 2):
            continue
        plane = LaserPlane.through(a, normal / length)
        median = float(np.median(np.abs(plane.signed_distance(sample))))
        if median < best_median:
            best, best_median = plane, median
    if best is None:
        raise ValueError("the points lie on one line and span no plane")
    residuals = best.signed_distance(points)
    fit = None
    for _ in range(_ROBUST_ROUNDS):
        sigma = max(_MAD_TO_SIGMA * float(np.median(np.abs(residuals))), 1e-9)
        scaled = residuals / (_TUKEY * sigma)
        is_inlier = np.abs(scaled) < 1.0
        fit = _fit_weighted(points, np.where(is_inlier, (1.0 - scaled**2) ** 2, 0.0), is_inlier)
        residuals = fit.residuals
    assert fit is not None
    return fit


def _fit_weighted(points: Points, weights: Floats, is_inlier: NDArray[np.bool_]) -> PlaneFit:
    if np.count_nonzero(weights) < 3:
        raise ValueError("a plane needs three points")
    centroid = weights @ points / weights.sum()
    centred = points - centroid
    _, singular, directions = np.linalg.svd(np.sqrt(weights)[:, None] * centred, full_matrices=False)
    plane = LaserPlane.through(centroid, directions[2])
    return PlaneFit(
        plane, centroid, plane.signed_distance(points), is_inlier, singular / np.sqrt(weights.sum())
    )
