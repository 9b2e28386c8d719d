"""Points with what is known about each."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False, slots=True)
class PointCloud:
    """N points in the table frame; a `Profile` is the cloud of one stop of the table.

    Attributes:
        points: (N, 3) float32 mm.
        normals: (N, 3) float32 unit vectors out of the surface; zeros where unknown.
        colours: (N, 3) uint8 red, green, blue.
        sigma_mm: (N,) float32 standard deviation along the viewing ray's shift; NaN where unknown.
        laser: (N,) uint8 index into `laser_names`.
        angle_deg: (N,) float32 table angle at which the point was seen, counter-clockwise.
        quality: (N,) float32 0..1, one is best.
        laser_names: what the indices mean.
    """

    points: NDArray[np.float32]
    normals: NDArray[np.float32]
    colours: NDArray[np.uint8]
    sigma_mm: NDArray[np.float32]
    laser: NDArray[np.uint8]
    angle_deg: NDArray[np.float32]
    quality: NDArray[np.float32]
    laser_names: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.points)

    @classmethod
    def empty(cls, laser_names: tuple[str, ...] = ()) -> "PointCloud":
        vectors, scalars = np.zeros((0, 3), np.float32), np.zeros(0, np.float32)
        return cls(
            vectors, vectors, np.zeros((0, 3), np.uint8), scalars, np.zeros(0, np.uint8), scalars, scalars,
            laser_names,
        )  # fmt: skip

    def select(self, which: NDArray[np.bool_] | NDArray[np.intp]) -> "PointCloud":
        """The points of a mask or index array."""
        return PointCloud(
            self.points[which], self.normals[which], self.colours[which], self.sigma_mm[which],
            self.laser[which], self.angle_deg[which], self.quality[which], self.laser_names,
        )  # fmt: skip

    @staticmethod
    def joined(clouds: "list[PointCloud]") -> "PointCloud":
        """All points of clouds that share their laser names."""
        if not clouds:
            return PointCloud.empty()
        return PointCloud(
            np.concatenate([c.points for c in clouds]),
            np.concatenate([c.normals for c in clouds]),
            np.concatenate([c.colours for c in clouds]),
            np.concatenate([c.sigma_mm for c in clouds]),
            np.concatenate([c.laser for c in clouds]),
            np.concatenate([c.angle_deg for c in clouds]),
            np.concatenate([c.quality for c in clouds]),
            clouds[0].laser_names,
        )
