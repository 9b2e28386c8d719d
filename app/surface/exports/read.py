"""Reading the meshes that this program keeps."""

import io
from pathlib import Path

import cv2
import numpy as np

from app.errors import SurfaceError
from app.files import reason
from app.geometry.mesh import TriangleMesh
from app.surface.texture import Texture

_MOST_HEADER_BYTES = 2_000
_COLOURED = np.dtype([("place", "<f4", 3), ("colour", "u1", 3)])
_PLAIN = np.dtype([("place", "<f4", 3)])
_FACE = np.dtype([("count", "u1"), ("corners", "<i4", 3)])
_END = b"end_header\n"


def read_mesh(path: Path) -> TriangleMesh:
    """A mesh that `write_mesh` has written as PLY in mm.

    Raises:
        SurfaceError: it cannot be read, or is another sort of file.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise SurfaceError(f"{path.name} cannot be read: {reason(error)}.", "Make the mesh again.") from error
    end = data.find(_END, 0, _MOST_HEADER_BYTES) + len(_END)
    lines = data[:end].decode("ascii", "replace").split("\n")
    try:
        vertices, faces = _count(lines, "vertex"), _count(lines, "face")
        layout = _COLOURED if "property uchar red" in lines else _PLAIN
        split = end + vertices * layout.itemsize
        if "comment unit mm" not in lines or len(data) != split + faces * _FACE.itemsize:
            raise ValueError("the file has another length than its header says")
    except (StopIteration, ValueError):
        raise SurfaceError(f"{path.name} is no mesh of this program.", "Make the mesh again.") from None
    rows = np.frombuffer(data, layout, vertices, end)
    triangles = np.frombuffer(data, _FACE, faces, split)["corners"].astype(np.int32)
    if faces and not 0 <= triangles.min() <= triangles.max() < vertices:
        raise SurfaceError(f"{path.name} is damaged.", "Make the mesh again.")
    colours = rows["colour"].copy() if layout is _COLOURED else None
    return TriangleMesh(rows["place"].copy(), triangles, colours)


def read_texture(picture: Path, corners: Path, mesh: TriangleMesh) -> Texture:
    """A texture whose picture and corners were kept as PNG and as an array of NumPy.

    Raises:
        SurfaceError: they cannot be read, or belong to another mesh.
    """
    try:
        packed = np.frombuffer(picture.read_bytes(), np.uint8)
        places = np.load(io.BytesIO(corners.read_bytes()), allow_pickle=False)
    except OSError as error:
        raise SurfaceError(
            f"{picture.name} cannot be read: {reason(error)}.", "Make the mesh again."
        ) from error
    except (ValueError, EOFError):
        raise SurfaceError(f"{corners.name} is damaged.", "Make the mesh again.") from None
    image = cv2.imdecode(packed, cv2.IMREAD_COLOR) if len(packed) else None
    if image is None or places.shape != (len(mesh), 3, 2) or places.dtype != np.float32:
        raise SurfaceError(f"{picture.name} does not belong to its mesh.", "Make the mesh again.")
    return Texture(np.asarray(image[:, :, ::-1], np.uint8), places)


def mesh_counts(path: Path) -> tuple[int, int]:
    """Vertices and triangles that a kept mesh promises; only its header is read.

    Raises:
        SurfaceError: it cannot be read, or is another sort of file.
    """
    try:
        with path.open("rb") as file:
            lines = file.read(_MOST_HEADER_BYTES).split(_END)[0].decode("ascii", "replace").split("\n")
        return _count(lines, "vertex"), _count(lines, "face")
    except (OSError, StopIteration, ValueError):
        raise SurfaceError(f"{path.name} is no mesh of this program.", "Make the mesh again.") from None


def _count(lines: list[str], element: str) -> int:
    start = f"element {element} "
    return int(next(line.removeprefix(start) for line in lines if line.startswith(start)))
