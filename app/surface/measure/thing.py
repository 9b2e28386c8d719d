"""Clouds and meshes of any program, read from files."""

from pathlib import Path
from typing import TypeAlias

import numpy as np

from app.errors import PointCloudFileError
from app.geometry.cloud import PointCloud
from app.geometry.mesh import TriangleMesh
from app.surface.neighbours import is_finite
from app.surface.ply_reader import PlyFile
from app.surface.thinning import read_thinned

Thing: TypeAlias = PointCloud | TriangleMesh

MESH_ENDINGS = frozenset({".stl", ".obj", ".off", ".glb", ".3mf"})
MOST_POINTS = 4_000_000
"""Of a larger cloud an even choice is read."""
_HEADER_BYTES = 65_536


def file_points(path: Path) -> int:
    """How many points a cloud's file promises; 0 for a mesh.

    Raises:
        PointCloudFileError: it cannot be read.
    """
    return 0 if is_mesh_file(path) else PlyFile.open(path).points


def is_mesh_file(path: Path) -> bool:
    """Whether a file holds triangles: by its ending, and a PLY file by what its header promises."""
    if path.suffix.lower() != ".ply":
        return path.suffix.lower() in MESH_ENDINGS
    try:
        with path.open("rb") as file:
            header = file.read(_HEADER_BYTES).split(b"end_header")[0].split(b"\n")
    except OSError:
        return False
    faces = [line.split() for line in header if line.startswith(b"element face")]
    return bool(faces) and len(faces[0]) == 3 and faces[0][2].isdigit() and int(faces[0][2]) > 0


def read_thing(path: Path, most: int = MOST_POINTS) -> Thing:
    """A mesh (PLY with faces, STL, OBJ, OFF, GLB, 3MF) or a cloud (PLY).

    Args:
        most: points of a cloud; of a larger one every so many-th is taken.

    Raises:
        PointCloudFileError: it cannot be read.
    """
    return _read_mesh(path) if is_mesh_file(path) else read_cloud(path, most)


def read_cloud(path: Path, most: int = MOST_POINTS) -> PointCloud:
    """The finite points of a PLY file; of more than `most` every so many-th is taken.

    Raises:
        PointCloudFileError: it cannot be read.
    """
    cloud = read_thinned(path, most).cloud
    known = is_finite(cloud.points)
    return cloud if known.all() else cloud.select(known)


def points_of(thing: Thing) -> PointCloud:
    """A cloud, or the corners of a mesh with the mean normals of their triangles."""
    if isinstance(thing, PointCloud):
        return thing
    count = len(thing.vertices)
    normals = np.zeros((count, 3))
    outward = thing.face_vectors()
    for axis in range(3):
        for corner in range(3):
            normals[:, axis] += np.bincount(thing.faces[:, corner], outward[:, axis], count)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    ones = np.ones(count, np.float32)
    colours = np.full((count, 3), 200, np.uint8) if thing.colours is None else thing.colours
    return PointCloud(
        thing.vertices, normals.astype(np.float32), colours, np.nan * ones, np.zeros(count, np.uint8),
        0.0 * ones, ones,
    )  # fmt: skip


def _read_mesh(path: Path) -> TriangleMesh:
    import trimesh  # takes half a second, which only meshes need

    try:
        loaded = trimesh.load(path, force="mesh", process=False)
        vertices, faces = np.asarray(loaded.vertices), np.asarray(loaded.faces)
    # A foreign reader, which raises whatever it meets.
    except Exception as error:
        raise PointCloudFileError(
            str(path), f"is no mesh that can be read ({type(error).__name__})",
            "Export it again, as binary STL or PLY.",
        ) from error  # fmt: skip
    if not len(faces) or not np.isfinite(vertices).all():
        raise PointCloudFileError(str(path), "has no triangles, or corners that are nowhere")
    return TriangleMesh(vertices.astype(np.float32), faces.astype(np.int32))
