"""How large a thing is."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.errors import SurfaceError
from app.geometry.arrays import Floats, Vector3
from app.geometry.mesh import TriangleMesh
from app.surface.neighbours import is_finite


@dataclass(frozen=True, eq=False, slots=True)
class Size:
    """The boxes around a thing, and what a mesh encloses.

    Attributes:
        low_mm, high_mm: (3,) corners of the box along the axes of its frame.
        smallest_mm: (3,) length, width and height of the smallest upright box.
        turned_deg: from x to that box's length, 0 to 180.
        area_mm2: of a mesh; None for a cloud.
        volume_mm3: of a closed mesh; None where it is open, and for a cloud.
    """

    low_mm: Vector3
    high_mm: Vector3
    smallest_mm: Vector3
    turned_deg: float
    area_mm2: float | None = None
    volume_mm3: float | None = None

    def as_json(self) -> dict[str, Any]:
        return {
            "low_mm": self.low_mm.tolist(),
            "high_mm": self.high_mm.tolist(),
            "extent_mm": (self.high_mm - self.low_mm).tolist(),
            "smallest_mm": self.smallest_mm.tolist(),
            "turned_deg": self.turned_deg,
            "area_mm2": self.area_mm2,
            "volume_mm3": self.volume_mm3,
        }


def size_of_points(points: NDArray[Any]) -> Size:
    """Of points (N, 3) mm; those that are not finite are left out.

    Raises:
        SurfaceError: there are none.
    """
    known = points[is_finite(points)].astype(np.float64)
    if not len(known):
        raise SurfaceError("There are no points to measure.")
    low, high = known.min(axis=0), known.max(axis=0)
    length, width, turned_deg = _smallest_rectangle(known[:, :2])
    return Size(low, high, np.array([length, width, high[2] - low[2]]), turned_deg)


def size_of_mesh(mesh: TriangleMesh) -> Size:
    """Of a mesh, with its area, and its volume where it is closed.

    Raises:
        SurfaceError: it has no triangles.
    """
    if not len(mesh):
        raise SurfaceError("There are no triangles to measure.")
    size = size_of_points(mesh.vertices[np.unique(mesh.faces)])
    return Size(
        size.low_mm, size.high_mm, size.smallest_mm, size.turned_deg, mesh.area_mm2,
        abs(mesh.volume_mm3) if is_closed(mesh) else None,
    )  # fmt: skip


def is_closed(mesh: TriangleMesh) -> bool:
    """Whether every edge is shared by two triangles that run along it in opposite directions.

    Corners at one place count as one, so that files that repeat them (STL) are judged rightly.
    """
    _, corner = np.unique(mesh.vertices, axis=0, return_inverse=True)
    faces = corner.reshape(-1)[mesh.faces].astype(np.int64)
    count = len(mesh.vertices) + 1
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    edges = edges[edges[:, 0] != edges[:, 1]]
    there = np.sort(edges[:, 0] * count + edges[:, 1])
    back = np.sort(edges[:, 1] * count + edges[:, 0])
    return bool(len(there)) and bool(np.array_equal(there, back))


def _smallest_rectangle(points: Floats) -> tuple[float, float, float]:
    """Length, width and direction in degrees of the smallest rectangle about points (N, 2).

    One of its sides lies along a side of the points' hull.
    """
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = points[ConvexHull(points).vertices]
    except (QhullError, ValueError):
        # All on one line, or too few: the line's own direction.
        hull = points[[int(np.argmin(points @ [1.0, 1e-3])), int(np.argmax(points @ [1.0, 1e-3]))]]
    sides = np.roll(hull, -1, axis=0) - hull
    angles = np.unique(np.arctan2(sides[:, 1], sides[:, 0]) % (np.pi / 2.0))
    along = np.column_stack([np.cos(angles), np.sin(angles)]) @ hull.T
    across = np.column_stack([-np.sin(angles), np.cos(angles)]) @ hull.T
    lengths, widths = np.ptp(along, axis=1), np.ptp(across, axis=1)
    best = int(np.argmin(lengths * widths))
    length, width, angle = float(lengths[best]), float(widths[best]), float(angles[best])
    if width > length:
        length, width, angle = width, length, angle + np.pi / 2.0
    return length, width, float(np.degrees(angle) % 180.0)
