"""What one laser adds at one angle of the table."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.geometry.cloud import PointCloud
from app.geometry.rig import Triangulator
from app.vision.stripe import LaserStripe, Orientation


@dataclass(frozen=True, eq=False, slots=True)
class Profile:
    """The points of one laser at one stop of the table.

    Attributes:
        number: of the stop, counted from 0.
        laser: its name.
        angle_rad: true angle of the table.
        cloud: the points, table frame.
    """

    number: int
    laser: str
    angle_rad: float
    cloud: PointCloud

    def __len__(self) -> int:
        return len(self.cloud)


@dataclass(frozen=True, eq=False, slots=True)
class Slice:
    """A triangulated stripe before its neighbours are known.

    Attributes:
        number, laser, angle_rad: as in `Profile`.
        stripe: N stripe points, all of which met the laser plane.
        points: (N, 3) mm, table frame.
        sigma_mm: (N,) standard deviation along the laser sheet.
        colours: (N, 3) red, green, blue.
        camera: (3,) centre of the camera in the table frame at this angle.
    """

    number: int
    laser: str
    angle_rad: float
    stripe: LaserStripe
    points: NDArray[np.float32]
    sigma_mm: NDArray[np.float32]
    colours: NDArray[np.uint8]
    camera: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.points)


def triangulated(
    triangulator: Triangulator, laser: str, angle_rad: float, stripe: LaserStripe, orientation: Orientation
) -> tuple[LaserStripe, NDArray[np.float32], NDArray[np.float32]]:
    """The stripe points that meet the laser plane, where they lie on the table, and their sigma in mm."""
    points = triangulator.points(stripe.pixels, laser, angle_rad)
    is_met = np.asarray(np.isfinite(points).all(axis=1), np.bool_)
    if not is_met.all():
        stripe, points = stripe.select(is_met), points[is_met]
    half = np.array([0.5, 0.0] if orientation == "vertical" else [0.0, 0.5])
    ahead = triangulator.points(stripe.pixels + half, laser, 0.0)
    back = triangulator.points(stripe.pixels - half, laser, 0.0)
    # `Rig.depth_per_pixel`, from the table of rays.
    per_pixel = np.sqrt(np.sum((ahead - back) ** 2, axis=1))
    sigma: NDArray[np.float32] = (np.sqrt(stripe.variance) * per_pixel).astype(np.float32)
    return stripe, points, sigma


def without_scraps(stripe: LaserStripe, shortest: int) -> LaserStripe:
    """The pieces of a stripe that have at least so many points."""
    if not len(stripe):
        return stripe
    _, piece, length = np.unique(stripe.segment, return_inverse=True, return_counts=True)
    return stripe.select(length[piece] >= shortest)
