"""Meshes as 3MF, with their unit in the file."""

import io
import zipfile
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from app.geometry.mesh import TriangleMesh
from app.surface.exports.portions import portions
from app.surface.exports.units import Unit

_HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n'
_TYPES = (
    f'{_HEAD}<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
    '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
    '<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>'
    "</Types>"
)
_RELATIONS = (
    f'{_HEAD}<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
    '<Relationship Target="/3D/3dmodel.model" Id="rel0" '
    'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>'
)


def three_mf_parts(mesh: TriangleMesh, unit: Unit) -> Iterator[bytes]:
    """3MF with one object, and the colours of its vertices as the materials extension has them."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED, compresslevel=6) as archive:
        archive.writestr("[Content_Types].xml", _TYPES)
        archive.writestr("_rels/.rels", _RELATIONS)
        with archive.open("3D/3dmodel.model", "w", force_zip64=True) as model:
            for text in _model(mesh, unit):
                model.write(text.encode("ascii"))
    yield packed.getvalue()


def _model(mesh: TriangleMesh, unit: Unit) -> Iterator[str]:
    yield (
        f'{_HEAD}<model unit="{unit.word}" xml:lang="en-US" '
        'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02" '
        'xmlns:m="http://schemas.microsoft.com/3dmanufacturing/material/2015/02">'
        '<metadata name="Application">Turnscan</metadata><resources>'
    )
    shades, of_vertex = _shades(mesh)
    if len(shades):
        yield '<m:colorgroup id="2">'
        for part in portions(shades):
            yield "".join(f'<m:color color="#{shade:06X}FF"/>' for shade in part.tolist())
        yield "</m:colorgroup>"
    coloured = ' pid="2" pindex="0"' if len(shades) else ""
    yield f'<object id="1" type="model"{coloured}><mesh><vertices>'
    for vertices in portions(mesh.vertices):
        rows = (vertices.astype(float) * unit.per_mm).tolist()
        yield "".join(f'<vertex x="{x:.7g}" y="{y:.7g}" z="{z:.7g}"/>' for x, y, z in rows)
    yield "</vertices><triangles>"
    for faces in portions(mesh.faces):
        if len(shades) < 2:
            yield "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in faces.tolist())
            continue
        rows = np.hstack([faces, of_vertex[faces]]).tolist()
        yield "".join(
            f'<triangle v1="{a}" v2="{b}" v3="{c}" pid="2" p1="{d}" p2="{e}" p3="{f}"/>'
            for a, b, c, d, e, f in rows
        )
    yield '</triangles></mesh></object></resources><build><item objectid="1"/></build></model>'


def _shades(mesh: TriangleMesh) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(C,) different colours as one number each, and (V,) which of them each vertex has; none without."""
    if mesh.colours is None:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    numbers = mesh.colours.astype(np.int64) @ np.array([65_536, 256, 1])
    shades, of_vertex = np.unique(numbers, return_inverse=True)
    return shades, of_vertex.astype(np.int64)
