"""Writing meshes and clouds, each by the ending of its file."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np

from app.errors import OptionError
from app.files import replacing
from app.geometry.cloud import PointCloud
from app.geometry.mesh import TriangleMesh
from app.surface.exports.glb import glb_parts
from app.surface.exports.las import write_las
from app.surface.exports.mesh_bytes import obj_parts, off_parts, ply_parts, stl_parts
from app.surface.exports.textured_obj import write_textured_obj
from app.surface.exports.three_mf import three_mf_parts
from app.surface.exports.units import Unit
from app.surface.ply import write_ply
from app.surface.texture import Texture

_MESHES: Mapping[str, Callable[[TriangleMesh, Unit], Iterator[bytes]]] = {
    ".stl": stl_parts, ".3mf": three_mf_parts, ".ply": ply_parts, ".obj": obj_parts, ".glb": glb_parts,
    ".off": off_parts,
}  # fmt: skip
MESH_SUFFIXES = tuple(_MESHES)
TEXTURE_SUFFIXES = (".obj", ".glb")
CLOUD_SUFFIXES = (".ply", ".xyz", ".las", ".laz")
_LINES = 50_000


def mesh_parts(
    suffix: str, mesh: TriangleMesh, unit: Unit = Unit.MM, texture: Texture | None = None
) -> Iterator[bytes]:
    """The bytes of a mesh in the form of that ending.

    Args:
        suffix: such as `.stl`.
        mesh: in mm.
        unit: of the numbers.
        texture: a picture of its colours, for GLB; the other forms have no place for one within.

    Raises:
        OptionError: there is no such form.
    """
    maker = _MESHES.get(suffix.lower())
    if maker is None:
        raise _unknown("mesh", suffix, MESH_SUFFIXES)
    return glb_parts(mesh, unit, texture) if suffix.lower() == ".glb" else maker(mesh, unit)


def write_mesh(
    path: Path, mesh: TriangleMesh, unit: Unit | str = Unit.MM, texture: Texture | None = None
) -> None:
    """A mesh in the form that the ending of its name tells; a file that is there is replaced.

    Args:
        path: where to.
        mesh: in mm.
        unit: of the numbers in the file; GLB is always in metres.
        texture: a picture of its colours: within GLB, and in the files of `beside_obj` with OBJ.

    Raises:
        OptionError: there is no such form.
        OutputError: it cannot be written.
    """
    if texture is not None and path.suffix.lower() == ".obj":
        write_textured_obj(path, mesh, Unit(unit), texture)
        return
    parts = mesh_parts(path.suffix, mesh, Unit(unit), texture)
    with replacing(path, is_durable=False) as file:
        file.writelines(parts)


def write_cloud(path: Path, cloud: PointCloud) -> None:
    """A cloud in the form that the ending of its name tells; a file that is there is replaced.

    PLY keeps everything; XYZ is text of x, y, z in mm and red, green, blue; LAS and LAZ hold positions to a
    micrometre and colours, in mm, too.

    Raises:
        OptionError: there is no such form.
        OutputError: it cannot be written.
    """
    match path.suffix.lower():
        case ".ply":
            write_ply(path, cloud)
        case ".xyz":
            with replacing(path, is_durable=False) as file:
                for first in range(0, len(cloud), _LINES):
                    file.write(xyz_lines(cloud.select(np.arange(first, min(first + _LINES, len(cloud))))))
        case ".las" | ".laz":
            with replacing(path, is_durable=False) as file:
                write_las(file, cloud, is_packed=path.suffix.lower() == ".laz")
        case other:
            raise _unknown("cloud", other, CLOUD_SUFFIXES)


def xyz_lines(cloud: PointCloud) -> bytes:
    """A line of text for each point: x y z in mm, red green blue."""
    rows = zip(cloud.points.tolist(), cloud.colours.tolist(), strict=True)
    return "".join(
        f"{x:.4f} {y:.4f} {z:.4f} {red} {green} {blue}\n" for (x, y, z), (red, green, blue) in rows
    ).encode("ascii")


def _unknown(what: str, suffix: str, known: tuple[str, ...]) -> OptionError:
    given = suffix[:20] or "a name without an ending"
    return OptionError(
        f"A {what} cannot be written as {given}.", f"Name a file that ends in {', '.join(known)}."
    )
