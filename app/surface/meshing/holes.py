"""Small holes of an open mesh, closed."""

from collections.abc import Iterator

import numpy as np

from app.geometry.mesh import TriangleMesh
from app.surface.meshing.topology import rim_edges


def fill_holes(mesh: TriangleMesh, widest_mm: float) -> TriangleMesh:
    """Close every hole that is no wider than that with triangles around its middle.

    Rims that touch themselves stay open, and so does the rim of a piece that lies flat by itself.
    """
    vertices, faces = [mesh.vertices], [mesh.faces]
    colours = [] if mesh.colours is None else [mesh.colours]
    count = len(mesh.vertices)
    for rim in _rims(mesh):
        corners = mesh.vertices[rim]
        if np.ptp(corners, axis=0).max() > widest_mm:
            continue
        following = np.roll(rim, -1)
        # Against the direction of the triangles outside.
        faces.append(np.column_stack([following, rim, np.full(len(rim), count)]).astype(np.int32))
        vertices.append(corners.mean(axis=0, keepdims=True))
        if mesh.colours is not None:
            colours.append(np.rint(mesh.colours[rim].mean(axis=0, keepdims=True)).astype(np.uint8))
        count += 1
    return TriangleMesh(
        np.concatenate(vertices), np.concatenate(faces), np.concatenate(colours) if colours else None
    )


def _rims(mesh: TriangleMesh) -> Iterator[np.ndarray[tuple[int], np.dtype[np.int64]]]:
    """The vertices around each hole, in order."""
    edges = rim_edges(mesh)
    starts, counts = np.unique(edges[:, 0], return_counts=True)
    is_forked = set(starts[counts > 1].tolist())
    following = dict(edges.tolist())
    while following:
        first, here = following.popitem()
        rim = [first]
        while here != first and here in following:
            rim.append(here)
            here = following.pop(here)
        if here == first and len(rim) > 2 and not is_forked.intersection(rim):
            yield np.array(rim, np.int64)
