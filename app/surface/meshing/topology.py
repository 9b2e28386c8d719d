"""How the triangles of a mesh hang together."""

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats
from app.geometry.mesh import TriangleMesh


def directed_edges(faces: NDArray[np.int32]) -> NDArray[np.int64]:
    """(3F, 2) the edges of all triangles, in the direction of each."""
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)


def rim_edges(mesh: TriangleMesh) -> NDArray[np.int64]:
    """(E, 2) edges that have a triangle on one side alone, in the direction of that triangle."""
    edges = directed_edges(mesh.faces)
    keys = np.sort(edges, axis=1) @ np.array([max(len(mesh.vertices), 1), 1])
    _, first, counts = np.unique(keys, return_index=True, return_counts=True)
    rims: NDArray[np.int64] = edges[first[counts == 1]]
    return rims


def is_watertight(mesh: TriangleMesh) -> bool:
    """Whether every edge has two triangles, one in each direction."""
    edges = directed_edges(mesh.faces)
    if not len(edges) or bool(np.any(edges[:, 0] == edges[:, 1])):
        return False
    size = len(mesh.vertices)
    there, back = edges @ np.array([size, 1]), edges @ np.array([1, size])
    there.sort()
    back.sort()
    return bool(np.array_equal(there, back) and np.all(np.diff(there) > 0))


def pieces_of(mesh: TriangleMesh) -> NDArray[np.int32]:
    """(F,) which of its pieces each triangle belongs to; pieces hang together by vertices."""
    # As in `Places.of`.
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    size = len(mesh.vertices)
    edges = directed_edges(mesh.faces)
    graph = coo_array((np.ones(len(edges), np.int8), (edges[:, 0], edges[:, 1])), shape=(size, size))
    _, labels = connected_components(graph, directed=False)
    found: NDArray[np.int32] = np.unique(labels[mesh.faces[:, 0]], return_inverse=True)[1].astype(np.int32)
    return found


def piece_areas(mesh: TriangleMesh, pieces: NDArray[np.int32]) -> Floats:
    """mm^2 of each piece."""
    areas = 0.5 * np.linalg.norm(mesh.face_vectors(), axis=1)
    total: Floats = np.bincount(pieces, areas).astype(np.float64)
    return total


def with_faces(mesh: TriangleMesh, faces: NDArray[np.int32]) -> TriangleMesh:
    """A mesh of these triangles, without the vertices that none of them uses."""
    used, numbers = np.unique(faces, return_inverse=True)
    colours = None if mesh.colours is None else mesh.colours[used]
    return TriangleMesh(mesh.vertices[used], numbers.reshape(-1, 3).astype(np.int32), colours)


def without_islands(mesh: TriangleMesh, least_share: float) -> TriangleMesh:
    """Without the pieces whose area is less than that share of the largest one's."""
    if not len(mesh):
        return mesh
    pieces = pieces_of(mesh)
    areas = piece_areas(mesh, pieces)
    is_large = areas >= least_share * areas.max()
    return mesh if is_large.all() else with_faces(mesh, mesh.faces[is_large[pieces]])


def welded(mesh: TriangleMesh) -> TriangleMesh:
    """Vertices at one place made one, as readers of STL do, and triangles without area left out.

    A closed mesh stays as it is where that would open it.
    """
    keys = np.ascontiguousarray(mesh.vertices + np.float32(0.0)).view(np.dtype((np.void, 12))).ravel()
    _, first, numbers = np.unique(keys, return_index=True, return_inverse=True)
    if len(first) == len(mesh.vertices):
        return mesh
    faces = first[numbers][mesh.faces].astype(np.int32)
    a, b, c = faces.T
    fewer = with_faces(mesh, faces[(a != b) & (b != c) & (c != a)])
    return fewer if is_watertight(fewer) or not is_watertight(mesh) else mesh
