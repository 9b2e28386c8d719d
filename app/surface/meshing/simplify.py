"""Fewer triangles: so many, or as few as a tolerance allows."""

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Points
from app.geometry.mesh import TriangleMesh
from app.surface.meshing.topology import is_watertight
from app.surface.signed_distance import distances_to_mesh

_STEP = 0.6
_FLAT_SHARE = 0.6
_FEWEST = 100
_MEASURED_POINTS = 30_000
# Of the points that were measured; single ones stand at edges that no triangle of that size can follow.
_WITHIN_PERCENTILE = 99.5


def to_count(mesh: TriangleMesh, triangles: int) -> TriangleMesh:
    """A mesh of at most so many triangles; as few as can be where it would lose its closedness before."""
    if len(mesh) <= triangles:
        return mesh
    fewer = _reduced(mesh, triangles)
    if not is_watertight(mesh) or is_watertight(fewer):
        return fewer
    # What goes wrong in one leap goes well in steps, or stops where it does not.
    kept = mesh
    while len(kept) > triangles:
        fewer = _reduced(kept, max(triangles, int(_STEP * len(kept))))
        if not is_watertight(fewer) or len(fewer) >= len(kept):
            break
        kept = fewer
    return kept


def to_tolerance(mesh: TriangleMesh, tolerance_mm: float) -> TriangleMesh:
    """The mesh of fewest triangles, in steps, whose surface lies within a distance of where it was.

    The distance is measured from the vertices that there were: 99.5 of 100 lie within it.
    """
    must_close = is_watertight(mesh)
    asked = mesh.vertices[:: -(-len(mesh.vertices) // _MEASURED_POINTS) or 1].astype(np.float64)

    def may_stand_for_it(fewer: TriangleMesh) -> bool:
        if not len(fewer) or (must_close and not is_watertight(fewer)):
            return False
        return bool(
            np.percentile(np.abs(distances_to_mesh(asked, fewer)), _WITHIN_PERCENTILE) <= tolerance_mm
        )

    kept = mesh
    if must_close:
        # What is flat within the tolerance goes first: leaps move sharp edges before they empty faces.
        flat = _flattened(mesh, _FLAT_SHARE * tolerance_mm)
        kept = flat if may_stand_for_it(flat) else mesh
    while len(kept) > _FEWEST:
        fewer = _reduced(kept, int(_STEP * len(kept)))
        if len(fewer) >= 0.95 * len(kept) or not may_stand_for_it(fewer):
            break
        kept = fewer
    return kept


def _flattened(mesh: TriangleMesh, tolerance_mm: float) -> TriangleMesh:
    """With edges collapsed that lie flat; nothing where the mesh is no solid."""
    # Loaded here: few commands need it.
    from manifold3d import Manifold, Mesh

    solid = Manifold(Mesh(np.ascontiguousarray(mesh.vertices), mesh.faces.astype(np.uint32)))
    found = solid.simplify(tolerance_mm).to_mesh()
    return _coloured_like(mesh, np.asarray(found.vert_properties)[:, :3], np.asarray(found.tri_verts))


def _reduced(mesh: TriangleMesh, triangles: int) -> TriangleMesh:
    # Loaded here: few commands need it.
    import fast_simplification

    vertices, faces = fast_simplification.simplify(
        mesh.vertices.astype(np.float64), mesh.faces, target_count=triangles
    )[:2]
    return _coloured_like(mesh, vertices, faces)


def _coloured_like(mesh: TriangleMesh, vertices: Points, faces: NDArray[np.integer]) -> TriangleMesh:
    colours = None
    if mesh.colours is not None and len(vertices):
        # As in `Places.of`.
        from scipy.spatial import cKDTree

        _, nearest = cKDTree(mesh.vertices).query(vertices, workers=-1)
        colours = mesh.colours[nearest]
    return TriangleMesh(vertices.astype(np.float32), faces.astype(np.int32), colours)
