"""A scan reduced to what aligning needs: evenly spread points that know their outside."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from app.errors import SurfaceError
from app.geometry.arrays import Floats, Points
from app.geometry.cloud import PointCloud
from app.geometry.transform import RigidTransform
from app.surface.neighbours import cell_keys
from app.surface.normals import has_normals, with_normals
from app.surface.steps.table import Table
from app.surface.thinning import without_copies
from app.surface.view_direction import knows_angles, towards_camera

_FEWEST_POINTS = 50
_LEAST_EXTENT_MM = 1e-3
_START_CELLS = 40.0
_ROUNDS = 4
_FAR = 0.5
# How far beside the surface a mean of half a ball would be, in cells; of less bent pieces in proportion.
_BENT_CELLS = 0.3


@dataclass(frozen=True, eq=False, slots=True)
class Sample:
    """Points of a scan.

    Attributes:
        points: (N, 3) mm.
        normals: (N, 3) unit vectors out of the surface.
        towards: (N, 3) unit vectors to the camera; zeros where that is not known.
        sigma_mm: (N,) standard deviation of each along its normal.
    """

    points: Points
    normals: Points
    towards: Points
    sigma_mm: Floats

    def __len__(self) -> int:
        return len(self.points)

    @classmethod
    def of(cls, cloud: PointCloud) -> Self:
        """All points of a cloud whose points are finite and have normals."""
        sees = knows_angles(cloud)
        towards = towards_camera(cloud) if sees else np.zeros((len(cloud), 3))
        return cls(
            cloud.points.astype(np.float64), _unit(cloud.normals.astype(np.float64)),
            np.nan_to_num(towards), known_sigma(cloud),
        )  # fmt: skip

    def moved(self, pose: RigidTransform) -> "Sample":
        return Sample(
            pose @ self.points, self.normals @ pose.rotation.T, self.towards @ pose.rotation.T, self.sigma_mm
        )

    def select(self, which: NDArray[np.intp]) -> "Sample":
        return Sample(self.points[which], self.normals[which], self.towards[which], self.sigma_mm[which])

    def extent_mm(self) -> float:
        """Diagonal of the box that holds nearly all points."""
        low, high = np.quantile(self.points, [0.005, 0.995], axis=0)
        return float(np.linalg.norm(high - low))

    def thinned(self, cell_mm: float) -> "Sample":
        """One mean point for each cell and side: the two faces of a thin wall stay apart.

        Where the surface bends within a cell, such as on the rim of a cup, the mean lies beside it, and
        stripes are seen beside it, too, from each side otherwise: such points are less sure than others.
        """
        keys = cell_keys(self.points, cell_mm)
        side = (self.normals > 0.0) @ np.array([1, 2, 4])
        order = np.lexsort((side, keys))
        is_new = (np.diff(keys[order], prepend=-1) != 0) | (np.diff(side[order], prepend=-1) != 0)
        starts = np.flatnonzero(is_new)
        count = np.diff(np.append(starts, len(order)))[:, None]

        def mean(values: Floats) -> Floats:
            summed: Floats = np.add.reduceat(values[order], starts, axis=0)
            return summed / count

        normals = mean(self.normals)
        variance = mean(self.sigma_mm[:, None] ** 2)[:, 0] / count[:, 0]
        bend = np.maximum(1.0 - np.einsum("ni,ni->n", normals, normals), 0.0)
        variance += bend * (_BENT_CELLS * cell_mm) ** 2
        return Sample(mean(self.points), _unit(normals), _unit(mean(self.towards)), np.sqrt(variance))

    def about(self, count: int) -> tuple["Sample", float]:
        """Thinned to roughly so many points, and the edge of the cells for it, mm.

        Of few points, half of them: cells below their spacing would take one each, wherever it lies.
        """
        count = min(count, len(self) // 2)
        cell = self.extent_mm() / _START_CELLS
        thinned = self.thinned(cell)
        for _ in range(_ROUNDS):
            if 0.8 * count < len(thinned) < 1.25 * count:
                break
            cell *= float(np.sqrt(len(thinned) / count))
            thinned = self.thinned(cell)
        return thinned, cell


def usable(cloud: PointCloud, name: str) -> PointCloud:
    """The points of a scan that belong to the thing, each with a normal, without what lies far away.

    The table stands in every scan and would be taken for a part of the thing; only clouds of this program
    are known to stand on one.

    Args:
        name: of the scan, for messages.

    Raises:
        SurfaceError: there is too little of it.
    """
    cloud = without_copies(cloud)
    _refuse_too_few(cloud, f"{name} has points at {len(cloud):,} different places")
    if cloud.laser_names:
        before = len(cloud)
        cloud = Table().apply(cloud)
        _refuse_too_few(cloud, f"{name} shows the table and {len(cloud):,} of {before:,} points above it")
    cloud = cloud.select(_near(cloud.points))
    if not has_normals(cloud):
        cloud = with_normals(cloud)
    cloud = cloud.select(np.abs(np.linalg.norm(cloud.normals, axis=1) - 1.0) < 0.1)
    _refuse_too_few(cloud, f"{name} has {len(cloud):,} points with a normal")
    if float(np.ptp(cloud.points, axis=0).max()) < _LEAST_EXTENT_MM:
        raise SurfaceError(f"All points of {name} lie in one place.", "Leave that scan out.")
    return cloud


def known_sigma(cloud: PointCloud) -> Floats:
    """(N,) mm; the usual one where a point's own is not known, and 1 where none is."""
    sigma = cloud.sigma_mm.astype(np.float64)
    is_known = np.isfinite(sigma) & (sigma > 0.0)
    usual = float(np.median(sigma[is_known])) if is_known.any() else 1.0
    # Nobody is so sure that all others count for nothing.
    return np.maximum(np.where(is_known, sigma, usual), 0.2 * usual)


def _near(points: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(N,) which points are not far away from nearly all others: a single one would make the thing huge."""
    low, high = np.quantile(points.astype(np.float64), [0.005, 0.995], axis=0)
    room = _FAR * float(np.linalg.norm(high - low))
    return np.asarray(((points >= low - room) & (points <= high + room)).all(axis=1), np.bool_)


def _refuse_too_few(cloud: PointCloud, what: str) -> None:
    if len(cloud) < _FEWEST_POINTS:
        raise SurfaceError(f"{what}; joining needs {_FEWEST_POINTS}.", "Leave that scan out, or scan again.")


def _unit(vectors: Points) -> Points:
    unit: Points = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
    return unit
