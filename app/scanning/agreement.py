"""Do two lasers see the same surface in the same place?"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats, Vector3

_NEIGHBOURS = 8
_FURTHEST_MM = 3.0
# The patch must be this much denser than the search radius is wide, and face the same way.
_SAME_FACING = 0.7
_FEWEST = 50
_ROUNDS = 5
_MAD_TO_SIGMA = 1.4826
_TUKEY = 4.685


@dataclass(frozen=True, eq=False, slots=True)
class LaserAgreement:
    """Distance of one laser's points from the surface that another one measured.

    Attributes:
        first, second: names of the lasers.
        pairs: how many points of the second lie on a surface of the first.
        offset_mm: median distance along the normal; positive where the second laser lies outside.
        shift_mm: (3,) how the second cloud would have to be moved onto the first, table frame.
        rms_mm: robust RMS distance along the normal, both lasers' noise included.
    """

    first: str
    second: str
    pairs: int
    offset_mm: float
    shift_mm: Vector3
    rms_mm: float

    @property
    def disagreement_mm(self) -> float:
        """The systematic part: the larger of the median offset and the length of the shift."""
        return max(abs(self.offset_mm), float(np.linalg.norm(self.shift_mm)))


def agreement(
    names: tuple[str, str], first: NDArray[np.float32], second: NDArray[np.float32]
) -> LaserAgreement | None:
    """Compare two clouds; None where they hardly overlap.

    The surface of the first around a point of the second: its eight nearest neighbours, where these face the
    same way and surround the point. Seen along their mean normal n they lie below a bulging surface, their
    own tangent planes n_i above it by as much; along (n + n_i) / 2 the bulge cancels.

    Args:
        names: of the two lasers.
        first, second: (N, 6) points and normals, mm, table frame; a zero normal is not known.
    """
    a = first[np.any(first[:, 3:] != 0.0, axis=1)].astype(np.float64)
    b = second[np.any(second[:, 3:] != 0.0, axis=1)].astype(np.float64)
    if len(a) < _NEIGHBOURS or len(b) < _FEWEST:
        return None
    from scipy.spatial import cKDTree  # a quarter of a second, which the server's start can do without

    found = cKDTree(a[:, :3]).query(b[:, :3], _NEIGHBOURS, distance_upper_bound=_FURTHEST_MM)
    distance, index = np.asarray(found[0]), np.asarray(found[1])
    is_close = np.isfinite(distance).all(axis=1)
    b, patch, reach = b[is_close], a[index[is_close]], distance[is_close][:, -1]
    place, normal = patch[:, :, :3].mean(axis=1), patch[:, :, 3:].mean(axis=1)
    straight = np.linalg.norm(normal, axis=1)
    gap = b[:, :3] - place
    mean_normal = normal / np.maximum(straight, 1e-9)[:, None]
    level = np.sum(gap * mean_normal, axis=1)
    sideways = np.sqrt(np.maximum(np.sum(gap**2, axis=1) - level**2, 0.0))
    between = (mean_normal[:, None] + patch[:, :, 3:]) / 2.0
    along = np.sum((b[:, None, :3] - patch[:, :, :3]) * between, axis=2).mean(axis=1)
    facing = np.sum(b[:, 3:] * normal, axis=1)
    keep = (straight > _SAME_FACING) & (facing > _SAME_FACING) & (sideways < 0.5 * reach)
    if np.count_nonzero(keep) < _FEWEST:
        return None
    along = along[keep]
    rms = _MAD_TO_SIGMA * float(np.median(np.abs(along)))
    shift = _shift(mean_normal[keep], along)
    return LaserAgreement(*names, len(along), float(np.median(along)), shift, rms)


def _shift(normal: Floats, along: Floats) -> Vector3:
    """Robust least squares for the translation that closes the gaps along the normals.

    Directions in which the surfaces hold nothing (along a flat table) stay at zero.
    """
    shift = np.zeros(3)
    for _ in range(_ROUNDS):
        residual = along + normal @ shift
        scaled = residual / (_TUKEY * max(_MAD_TO_SIGMA * float(np.median(np.abs(residual))), 1e-6))
        weights = np.where(np.abs(scaled) < 1.0, (1.0 - scaled**2) ** 2, 0.0)
        values, vectors = np.linalg.eigh((weights[:, None] * normal).T @ normal)
        held = values > 0.02 * values.sum()
        inverse = vectors[:, held] / values[held] @ vectors[:, held].T
        shift = -inverse @ (normal.T @ (weights * along))
    return shift
