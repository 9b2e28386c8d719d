"""A mesh as a file that other programs read, in whichever form is asked for."""

from collections.abc import Iterator
from typing import Literal, TypeAlias

from app.errors import NotThere
from app.geometry.mesh import TriangleMesh
from app.surface.exports.textured_obj import zipped_obj_parts
from app.surface.exports.units import Unit
from app.surface.exports.write import mesh_parts
from app.surface.texture import Texture

MeshForm: TypeAlias = Literal["ply", "stl", "3mf", "obj", "glb", "off", "obj-zip"]
"""The last one is an OBJ with its material and its picture, which are three files."""


def mesh_in_form(
    form: MeshForm, mesh: TriangleMesh, texture: Texture | None, name: str, unit: Unit = Unit.MM
) -> Iterator[bytes]:
    """The bytes of the file.

    Args:
        form: see there.
        mesh: in mm.
        texture: a picture of its colours, where there is one; GLB holds it.
        name: of the files within a zip file, without an ending.
        unit: of the numbers; GLB is always in metres.

    Raises:
        NotThere: a texture is asked for, and there is none.
    """
    if form != "obj-zip":
        return mesh_parts(f".{form}", mesh, unit, texture)
    if texture is None:
        raise NotThere("The mesh has no texture.", "Make it again with one, or ask for it as OBJ.")
    return zipped_obj_parts(mesh, unit, texture, name)
