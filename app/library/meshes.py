"""Meshes that were made of a scan's clouds, in its folder."""

from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from app.errors import NotThere, SurfaceError
from app.surface.exports.read import mesh_counts

MESHES_FOLDER = "meshes"


@dataclass(frozen=True, slots=True)
class MeshItem:
    """A mesh of a scan.

    Attributes:
        name: its file within `meshes/`, a PLY.
        path: where it lies.
        vertices, triangles: how many it has.
        size_bytes: of the file.
        created: when it was written.
    """

    name: str
    path: Path
    vertices: int
    triangles: int
    size_bytes: int
    created: datetime


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


def _item(path: Path) -> MeshItem:
    vertices, triangles = mesh_counts(path)
    facts = path.stat()
    return MeshItem(
        path.name, path, vertices, triangles, facts.st_size, datetime.fromtimestamp(facts.st_mtime, UTC)
    )
