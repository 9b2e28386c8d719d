"""OBJ with a picture of its colours: three files that belong together."""

import io
import zipfile
from collections.abc import Iterator
from pathlib import Path

from app.files import replacing, together, write_whole
from app.geometry.mesh import TriangleMesh
from app.surface.exports.mesh_bytes import mtl_bytes, obj_parts
from app.surface.exports.units import Unit
from app.surface.texture import Texture


def beside_obj(path: Path) -> tuple[Path, Path]:
    """The material and the picture that go with a textured OBJ, which cannot name files with blanks."""
    stem = "_".join(path.stem.split()) or "scan"
    return path.with_name(f"{stem}.mtl"), path.with_name(f"{stem}-texture.png")


def write_textured_obj(path: Path, mesh: TriangleMesh, unit: Unit, texture: Texture) -> None:
    """The OBJ and the files of `beside_obj`; those that are there are replaced.

    Raises:
        OutputError: they cannot be written; then all three are as they were.
    """
    material, picture = beside_obj(path)
    with together([picture, material, path]) as beside:
        write_whole(beside[picture], texture.png(), is_durable=False)
        write_whole(beside[material], mtl_bytes(picture.name), is_durable=False)
        with replacing(beside[path], is_durable=False) as file:
            file.writelines(obj_parts(mesh, unit, texture, material.name))


def zipped_obj_parts(mesh: TriangleMesh, unit: Unit, texture: Texture, name: str) -> Iterator[bytes]:
    """A zip file with an OBJ of that name, its material and its picture."""
    path = Path(f"{name}.obj")
    material, picture = beside_obj(path)
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED, compresslevel=6) as archive:
        with archive.open(path.name, "w", force_zip64=True) as file:
            file.writelines(obj_parts(mesh, unit, texture, material.name))
        archive.writestr(material.name, mtl_bytes(picture.name))
        # Packed already.
        archive.writestr(picture.name, texture.png(), zipfile.ZIP_STORED)
    yield packed.getvalue()
