"""Meshes that were made of a scan's clouds, in its folder."""

import io
import json
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from app.documents import Json
from app.errors import NotThere, OutputError, SurfaceError
from app.files import make_folder, reason, write_whole
from app.geometry.mesh import TriangleMesh
from app.library.library import Library
from app.library.log import write_line
from app.library.names import free_name
from app.library.work import changing, settle, work_folder
from app.surface.exports.read import mesh_counts, read_mesh, read_texture
from app.surface.exports.write import write_mesh
from app.surface.texture import Texture

MESHES_FOLDER = "meshes"
_PICTURE, _CORNERS = ".png", ".npy"
# Last the mesh itself, so that whoever sees it knows how it was made.
_ENDINGS = (".json", _PICTURE, _CORNERS, ".ply")


@dataclass(frozen=True, slots=True)
class MeshItem:
    """A mesh of a scan.

    Attributes:
        name: its file within `meshes/`, a PLY.
        path: where it lies.
        vertices, triangles: how many it has.
        size_bytes: of the file.
        created: when it was written.
        has_texture: whether a picture with its colours lies beside it.
        made: how it was made, as the job wrote it down; empty where that is not known.
    """

    name: str
    path: Path
    vertices: int
    triangles: int
    size_bytes: int
    created: datetime
    has_texture: bool = False
    made: Json = field(default_factory=dict)


def meshes_of(folder: Path) -> tuple[MeshItem, ...]:
    """Those of the scan in that folder, oldest first; files that are no meshes are passed over."""
    found = []
    with suppress(OSError):
        for path in (folder / MESHES_FOLDER).iterdir():
            if (
                path.suffix == ".ply"
                and not path.name.startswith(".")
                and path.is_file()
                and not path.is_symlink()
            ):
                with suppress(SurfaceError, OSError):
                    found.append(_item(path))
    return tuple(sorted(found, key=lambda item: (item.created, item.name)))


def mesh_of(folder: Path, name: str) -> MeshItem:
    """One of them.

    Raises:
        NotThere: there is none of that name.
    """
    for item in meshes_of(folder):
        if item.name == name:
            return item
    raise NotThere(f"The scan has no mesh {name[:60]!r}.", "Ask for its meshes, or make one.")


def loaded(item: MeshItem) -> tuple[TriangleMesh, Texture | None]:
    """A mesh, and the picture with its colours where it has one.

    Raises:
        SurfaceError: they cannot be read.
    """
    mesh = read_mesh(item.path)
    if not item.has_texture:
        return mesh, None
    return mesh, read_texture(item.path.with_suffix(_PICTURE), item.path.with_suffix(_CORNERS), mesh)


def keep_mesh(
    library: Library, scan: str, mesh: TriangleMesh, how: Json, kind: str, texture: Texture | None = None
) -> str:
    """Add a mesh to a scan; its file's name within `meshes/`.

    Args:
        library, scan: where.
        mesh: to be kept.
        how: it was made; lies beside it.
        kind: a word for its name.
        texture: a picture with its colours.

    Raises:
        ScanNotFound: there is no such scan any more.
        OutputError: it cannot be written.
    """
    with work_folder(library.folder) as work:
        write_whole(work / "mesh.json", json.dumps(how, indent=1, ensure_ascii=False).encode())
        write_mesh(work / "mesh.ply", mesh)
        if texture is not None:
            corners = io.BytesIO()
            np.save(corners, texture.corners, allow_pickle=False)
            write_whole(work / f"mesh{_PICTURE}", texture.png())
            write_whole(work / f"mesh{_CORNERS}", corners.getvalue())
        settle()
        with changing(library.folder):
            folder = library.scan(scan).folder / MESHES_FOLDER
            make_folder(folder)
            name = free_name(folder, f"{datetime.now(UTC):%Y-%m-%dT%H-%M-%S}Z-{kind}", ".ply")
            try:
                for ending in _ENDINGS:
                    if (made := work / f"mesh{ending}").exists():
                        made.replace((folder / name).with_suffix(ending))
            except OSError as error:
                raise OutputError(str(folder / name), reason(error)) from error
    return name


def erase_mesh(library: Library, scan: str, name: str) -> int:
    """Erase a mesh for good, with how it was made; how many bytes that gave back.

    Raises:
        ScanNotFound: there is no such scan.
        NotThere: it has no such mesh.
        OutputError: it cannot be erased.
    """
    with work_folder(library.folder) as work, changing(library.folder):
        folder = library.folder_of(scan)
        doomed = mesh_of(folder, name).path
        there = [path for ending in _ENDINGS[::-1] if (path := doomed.with_suffix(ending)).is_file()]
        freed = sum(path.stat().st_size for path in there)
        for path in there:
            path.rename(work / path.name)
        write_line(folder, f"Erased the mesh {name}.")
        return freed


def _item(path: Path) -> MeshItem:
    vertices, triangles = mesh_counts(path)
    facts = path.stat()
    created = datetime.fromtimestamp(facts.st_mtime, UTC)
    has_texture = all(path.with_suffix(ending).is_file() for ending in (_PICTURE, _CORNERS))
    return MeshItem(path.name, path, vertices, triangles, facts.st_size, created, has_texture, _made(path))


def _made(path: Path) -> Json:
    with suppress(OSError, ValueError):
        made = json.loads(path.with_suffix(".json").read_bytes())
        if isinstance(made, dict):
            return made
    return {}
