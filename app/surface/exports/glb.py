"""Meshes as GLB, the binary form of glTF 2.0."""

import json
import struct
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.geometry.mesh import TriangleMesh
from app.surface.exports.units import Unit
from app.surface.texture import Texture

_MAGIC, _VERSION = b"glTF", 2
_JSON, _BIN = b"JSON", b"BIN\0"
_FLOAT, _BYTE, _INT = 5126, 5121, 5125
_VERTICES, _FACES = 34962, 34963


def glb_parts(mesh: TriangleMesh, unit: Unit, texture: Texture | None = None) -> Iterator[bytes]:
    """GLB: in metres with y upwards, as its standard wants; the unit that was asked for changes nothing.

    Colours are those of the texture, where there is one; then every triangle has vertices of its own, because
    each has another place in the picture. Otherwise they are those of the vertices, made linear, which is
    what glTF counts in.
    """
    vertices, faces = mesh.vertices, mesh.faces
    if texture is not None:
        vertices, faces = (
            vertices[faces].reshape(-1, 3),
            np.arange(3 * len(faces), dtype=np.int32).reshape(-1, 3),
        )
    positions = (vertices[:, [0, 2, 1]] * np.array([1.0, 1.0, -1.0]) * Unit.M.per_mm).astype("<f4")
    low, high = (
        (positions.min(axis=0).tolist(), positions.max(axis=0).tolist())
        if len(positions)
        else ([0.0] * 3,) * 2
    )
    surface = {"baseColorFactor": [1.0, 1.0, 1.0, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.8}
    material: dict[str, Any] = {"pbrMetallicRoughness": surface, "doubleSided": True}
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "Turnscan"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "scan"}],
        "materials": [material],
    }
    blocks: list[tuple[bytes, dict[str, int]]] = []
    accessors: list[dict[str, Any]] = []

    def add(rows: NDArray[Any], target: int, facts: dict[str, Any]) -> int:
        """Another block of numbers; which accessor it has."""
        accessors.append({"bufferView": len(blocks), **facts})
        blocks.append((rows.tobytes(), {"target": target}))
        return len(accessors) - 1

    each = {"count": len(positions), "componentType": _FLOAT}
    attributes = {"POSITION": add(positions, _VERTICES, {**each, "type": "VEC3", "min": low, "max": high})}
    if texture is not None:
        places = texture.corners.reshape(-1, 2).astype("<f4")
        attributes["TEXCOORD_0"] = add(places, _VERTICES, {**each, "type": "VEC2"})
        surface["baseColorTexture"] = {"index": 0}
        document |= {
            "textures": [{"source": 0}],
            "images": [{"bufferView": len(blocks), "mimeType": "image/png"}],
        }
        blocks.append((texture.png(), {}))
    elif mesh.colours is not None:
        colours = {**each, "componentType": _BYTE, "type": "VEC4", "normalized": True}
        attributes["COLOR_0"] = add(_linear(mesh.colours), _VERTICES, colours)
    indices = {"count": faces.size, "componentType": _INT, "type": "SCALAR"}
    primitive = {
        "attributes": attributes,
        "indices": add(faces.astype("<u4"), _FACES, indices),
        "material": 0,
    }
    views, offset = [], 0
    for data, facts in blocks:
        views.append({"buffer": 0, "byteOffset": offset, "byteLength": len(data), **facts})
        offset += len(data) + _gap(data)
    document |= {
        "meshes": [{"primitives": [primitive]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": offset}],
    }
    text = json.dumps(document, separators=(",", ":")).encode("ascii")
    text += b" " * _gap(text)
    yield _MAGIC + struct.pack("<II", _VERSION, 12 + 8 + len(text) + 8 + offset)
    yield struct.pack("<I", len(text)) + _JSON + text
    yield struct.pack("<I", offset) + _BIN
    for data, _ in blocks:
        yield data + b"\0" * _gap(data)


def _gap(data: bytes) -> int:
    """Bytes up to the next multiple of four."""
    return -len(data) % 4


def _linear(colours: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(V, 4) from sRGB, with nothing transparent."""
    table = np.arange(256) / 255.0
    table = np.where(table <= 0.04045, table / 12.92, ((table + 0.055) / 1.055) ** 2.4)
    opaque = np.full((len(colours), 1), 255, np.uint8)
    return np.hstack([np.rint(255.0 * table).astype(np.uint8)[colours], opaque])
