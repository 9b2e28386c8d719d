"""Writing meshes and clouds, each by the ending of its file."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from app.errors import OptionError
from app.files import replacing
from app.geometry.cloud import PointCloud
from app.geometry.mesh import TriangleMesh
from app.surface.exports.glb import glb_parts
from app.surface.exports.las import write_las
from app.surface.exports.mesh_bytes import mtl_bytes, obj_parts, off_parts, ply_parts, stl_parts
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


def mesh_parts(suffix: str, mesh: TriangleMesh, unit: Unit = Unit.MM) -> Iterator[bytes]:
    """The bytes of a mesh in the form of that ending.

    Raises:
        OptionError: there is no such form.
    """
    maker = _MESHES.get(suffix.lower())
    if maker is None:
        raise _unknown("mesh", suffix, MESH_SUFFIXES)
    return maker(mesh, unit)


def write_mesh(path: Path, mesh: TriangleMesh, unit: Unit | str = Unit.MM) -> None:
    """A mesh in the form that the ending of its name tells; a file that is there is replaced.

    Args:
        path: where to.
        mesh: in mm.
        unit: of the numbers in the file; GLB is always in metres.

    Raises:
        OptionError: there is no such form.
        OutputError: it cannot be written.
    """
    parts = mesh_parts(path.suffix, mesh, Unit(unit))
    with replacing(path, is_durable=False) as file:
        for part in parts:
            file.write(part)


def write_textured(path: Path, mesh: TriangleMesh, texture: Texture, unit: Unit | str = Unit.MM) -> None:
    """A mesh with a picture of its colours, as GLB, or as OBJ with the files of `beside_obj`.

    Arguments and errors as of `write_mesh`.
    """
    if path.suffix.lower() == ".glb":
        with replacing(path, is_durable=False) as file:
            file.writelines(glb_parts(mesh, Unit(unit), texture))
        return
    if path.suffix.lower() != ".obj":
        raise _unknown("mesh with a texture", path.suffix, TEXTURE_SUFFIXES)
    material, picture = beside_obj(path)
    # All are written before the first takes its place.
    with ExitStack() as files:
        obj, mtl, png = (
            files.enter_context(replacing(each, is_durable=False)) for each in (path, material, picture)
        )
        png.write(texture.png())
        mtl.write(mtl_bytes(picture.name))
        obj.writelines(obj_parts(mesh, Unit(unit), texture, material.name))


def beside_obj(path: Path) -> tuple[Path, Path]:
    """The material and the picture that go with a textured OBJ, which cannot name files with blanks."""
    stem = "_".join(path.stem.split()) or "scan"
    return path.with_name(f"{stem}.mtl"), path.with_name(f"{stem}-texture.png")


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
