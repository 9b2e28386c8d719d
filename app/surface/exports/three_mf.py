"""Meshes as 3MF, with their unit in the file."""

import io
import zipfile
from collections.abc import Iterator

from app.geometry.mesh import TriangleMesh
from app.surface.exports.units import Unit

_AT_ONCE = 65_536
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
    """3MF with one object. Colours are left out: few slicers want them."""
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
        'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">'
        '<metadata name="Application">Turnscan</metadata>'
        '<resources><object id="1" type="model"><mesh><vertices>'
    )
    for first in range(0, len(mesh.vertices), _AT_ONCE):
        rows = (mesh.vertices[first : first + _AT_ONCE].astype(float) * unit.per_mm).tolist()
        yield "".join(f'<vertex x="{x:.7g}" y="{y:.7g}" z="{z:.7g}"/>' for x, y, z in rows)
    yield "</vertices><triangles>"
    for first in range(0, len(mesh), _AT_ONCE):
        rows = mesh.faces[first : first + _AT_ONCE].tolist()
        yield "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in rows)
    yield '</triangles></mesh></object></resources><build><item objectid="1"/></build></model>'
