"""Surfaces of triangles, and the curved surface that some of them stand for."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from app.errors import OptionError
from app.geometry.arrays import Floats, Points
from app.geometry.transform import RigidTransform

if TYPE_CHECKING:
    # It takes half a second to import; only some objects need it.
    from trimesh import Trimesh

# A triangle larger than this bends visibly under the lens's distortion.
_LONGEST_EDGE_MM = 12.0

Albedo = tuple[float, float, float]
"""Blue, green, red in 0..1."""


@dataclass(frozen=True, eq=False, slots=True)
class Mesh:
    """Triangles with smooth normals and a colour for every vertex.

    Attributes:
        vertices: (V, 3) mm in the body's own frame.
        normals: (V, 3) unit vectors out of the surface.
        faces: (F, 3) vertex numbers, counter-clockwise seen from outside.
        albedo: (V, 3) share of the light that comes back, as blue, green, red in 0..1.
        quadrics: (Q, 4, 4) curved surfaces [x 1] Q [x 1]^T = 0 in the body's frame.
        face_quadric: (F,) which of them a triangle stands for; -1 where the triangle is meant as it is.
        is_closed: whether nobody ever sees the back of a triangle.
    """

    vertices: Points
    normals: Points
    faces: NDArray[np.int32]
    albedo: NDArray[np.float32]
    quadrics: Floats
    face_quadric: NDArray[np.int32]
    is_closed: bool

    def moved(self, motion: RigidTransform) -> "Mesh":
        """The same surface elsewhere."""
        back = np.eye(4)
        inverse = motion.inverse()
        back[:3, :3], back[:3, 3] = inverse.rotation, inverse.translation
        return Mesh(
            motion @ self.vertices, self.normals @ motion.rotation.T, self.faces, self.albedo,
            back.T @ self.quadrics @ back, self.face_quadric, self.is_closed,
        )  # fmt: skip

    @staticmethod
    def joined(meshes: "list[Mesh]") -> "Mesh":
        """All triangles of all meshes as one body; closed where each of them is."""
        first_vertex = np.cumsum([0] + [len(m.vertices) for m in meshes])
        first_quadric = np.cumsum([0] + [len(m.quadrics) for m in meshes])
        return Mesh(
            np.concatenate([m.vertices for m in meshes]),
            np.concatenate([m.normals for m in meshes]),
            np.concatenate([m.faces + np.int32(n) for m, n in zip(meshes, first_vertex, strict=False)]),
            np.concatenate([m.albedo for m in meshes]),
            np.concatenate([m.quadrics for m in meshes]),
            np.concatenate(
                [
                    np.where(m.face_quadric >= 0, m.face_quadric + np.int32(n), np.int32(-1))
                    for m, n in zip(meshes, first_quadric, strict=False)
                ]
            ),
            all(m.is_closed for m in meshes),
        )

    def as_trimesh(self) -> "Trimesh":
        """For writing as STL or PLY."""
        from trimesh import Trimesh

        return Trimesh(self.vertices, self.faces, process=False)


def plain_mesh(vertices: Points, faces: NDArray[np.int32], albedo: Albedo, is_closed: bool = True) -> Mesh:
    """A mesh of one colour that is meant as it is.

    Args:
        vertices: (V, 3) mm; give a vertex twice to keep an edge sharp.
        faces: (F, 3) counter-clockwise seen from outside.
        albedo: blue, green, red in 0..1.
        is_closed: whether nobody ever sees the back of a triangle.
    """
    faces = np.asarray(faces, np.int32)
    return Mesh(
        np.asarray(vertices, np.float64),
        smooth_normals(vertices, faces),
        faces,
        np.tile(np.asarray(albedo, np.float32), (len(vertices), 1)),
        np.zeros((0, 4, 4)),
        np.full(len(faces), -1, np.int32),
        is_closed,
    )


def standing_for(mesh: Mesh, quadric: Floats, which: NDArray[np.bool_]) -> Mesh:
    """The mesh with some faces (F,) understood as parts of a curved surface (4, 4)."""
    return Mesh(
        mesh.vertices, mesh.normals, mesh.faces, mesh.albedo, quadric[None],
        np.where(which, 0, -1).astype(np.int32), mesh.is_closed,
    )  # fmt: skip


def smooth_normals(vertices: Points, faces: NDArray[np.int32]) -> Points:
    """Normals (V, 3): mean of the neighbouring triangles, each counted by its area."""
    corners = vertices[faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    total = np.zeros_like(vertices, np.float64)
    for corner in range(3):
        for axis in range(3):
            total[:, axis] += np.bincount(faces[:, corner], weights=across[:, axis], minlength=len(vertices))
    length = np.linalg.norm(total, axis=1, keepdims=True)
    upward = np.tile([0.0, 0.0, 1.0], (len(vertices), 1))
    normals: Points = np.divide(total, length, out=upward, where=length > 0.0)
    return normals


def from_trimesh(surface: "Trimesh", albedo: Albedo, sharp_deg: float = 40.0) -> Mesh:
    """A mesh of one colour whose edges sharper than `sharp_deg` stay sharp, cut into small triangles."""
    import trimesh

    cut, faces = trimesh.remesh.subdivide_to_size(
        surface.vertices, surface.faces, max_edge=_LONGEST_EDGE_MM, max_iter=20
    )
    whole = trimesh.Trimesh(cut, faces, process=True)
    creased = trimesh.graph.smooth_shade(whole, angle=np.radians(sharp_deg))
    return plain_mesh(
        np.asarray(creased.vertices, np.float64),
        np.asarray(creased.faces, np.int32),
        albedo,
        bool(whole.is_watertight and whole.is_winding_consistent),
    )


def load_mesh(path: Path, albedo: Albedo) -> Mesh:
    """A mesh from an STL, OBJ or PLY file in millimetres, as it lies in the file.

    Raises:
        OptionError: the file is missing, holds no triangles or is not a mesh.
    """
    import trimesh

    hint = "Name an STL, OBJ or PLY file with triangles, in millimetres."
    if not path.is_file():
        raise OptionError(f"There is no file {path}.", hint)
    try:
        surface = trimesh.load(path, force="mesh")
    except (ValueError, IndexError, KeyError, TypeError, NotImplementedError, OSError) as error:
        raise OptionError(f"{path} cannot be read as a mesh ({error}).", hint) from error
    if len(getattr(surface, "faces", ())) == 0 or not np.isfinite(surface.vertices).all():
        raise OptionError(f"{path} holds no triangles.", hint)
    surface.fix_normals()
    return from_trimesh(surface, albedo)
