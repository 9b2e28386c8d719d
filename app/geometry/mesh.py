"""A surface of triangles."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats, Vector3


@dataclass(frozen=True, eq=False, slots=True)
class TriangleMesh:
    """V vertices and F triangles, in the frame of the cloud it was made from.

    Attributes:
        vertices: (V, 3) float32 mm.
        faces: (F, 3) int32 numbers of vertices, counter-clockwise seen from outside.
        colours: (V, 3) uint8 red, green, blue; None where unknown.
    """

    vertices: NDArray[np.float32]
    faces: NDArray[np.int32]
    colours: NDArray[np.uint8] | None = None

    def __len__(self) -> int:
        """Triangles."""
        return len(self.faces)

    @classmethod
    def empty(cls) -> "TriangleMesh":
        return cls(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))

    def corners(self) -> Floats:
        """(F, 3, 3) mm: the three corners of each triangle."""
        return self.vertices.astype(np.float64)[self.faces]

    def face_vectors(self) -> Floats:
        """(F, 3) mm^2: outward normal of each triangle, as long as twice its area."""
        a, b, c = np.moveaxis(self.corners(), 1, 0)
        return np.cross(b - a, c - a)

    @property
    def area_mm2(self) -> float:
        return 0.5 * float(np.linalg.norm(self.face_vectors(), axis=1).sum())

    @property
    def volume_mm3(self) -> float:
        """Enclosed by the surface; without meaning where it is open."""
        a, b, c = np.moveaxis(self.corners(), 1, 0)
        return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0

    def bounds(self) -> tuple[Vector3, Vector3]:
        """Lowest and highest corner, mm. Raises ValueError for a mesh without vertices."""
        return self.vertices.min(axis=0).astype(np.float64), self.vertices.max(axis=0).astype(np.float64)
