"""Meshes as GLB, the binary form of glTF 2.0."""

import json
import struct
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.geometry.mesh import TriangleMesh
from app.surface.exports.units import Unit

_MAGIC, _VERSION = b"glTF", 2
_JSON, _BIN = b"JSON", b"BIN\0"
_FLOAT, _BYTE, _INT = 5126, 5121, 5125
_VERTICES, _FACES = 34962, 34963


def glb_parts(mesh: TriangleMesh, unit: Unit) -> Iterator[bytes]:
    """GLB: in metres with y upwards, as its standard wants; the unit that was asked for changes nothing.

    Colours are those of the vertices, made linear, which is what glTF counts in.
    """
    upright = mesh.vertices[:, [0, 2, 1]] * np.array([1.0, 1.0, -1.0]) * Unit.M.per_mm
    positions = upright.astype("<f4")
    blocks: list[tuple[bytes, int]] = [(positions.tobytes(), _VERTICES)]
    low, high = (
        (positions.min(axis=0).tolist(), positions.max(axis=0).tolist())
        if len(positions)
        else ([0.0] * 3,) * 2
    )
    count = len(mesh.vertices)
    accessors: list[dict[str, Any]] = [
        {"bufferView": 0, "componentType": _FLOAT, "count": count, "type": "VEC3", "min": low, "max": high}
    ]
    attributes = {"POSITION": 0}
    if mesh.colours is not None:
        attributes["COLOR_0"] = len(blocks)
        accessors.append(
            {"bufferView": 1, "componentType": _BYTE, "count": count, "type": "VEC4", "normalized": True}
        )
        blocks.append((_linear(mesh.colours).tobytes(), _VERTICES))
    accessors.append(
        {"bufferView": len(blocks), "componentType": _INT, "count": 3 * len(mesh), "type": "SCALAR"}
    )
    blocks.append((mesh.faces.astype("<u4").tobytes(), _FACES))
    primitive = {"attributes": attributes, "indices": len(blocks) - 1, "material": 0}
    # A vertex of float32 triples, RGBA and uint32 keeps every block at a multiple of four.
    views, offset = [], 0
    for data, target in blocks:
        views.append({"buffer": 0, "byteOffset": offset, "byteLength": len(data), "target": target})
        offset += len(data)
    surface = {"baseColorFactor": [1.0, 1.0, 1.0, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.8}
    document = {
        "asset": {"version": "2.0", "generator": "Turnscan"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "scan"}],
        "meshes": [{"primitives": [primitive]}],
        "materials": [{"pbrMetallicRoughness": surface, "doubleSided": True}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": offset}],
    }
    text = json.dumps(document, separators=(",", ":")).encode("ascii")
    text += b" " * (-len(text) % 4)
    yield _MAGIC + struct.pack("<II", _VERSION, 12 + 8 + len(text) + 8 + offset)
    yield struct.pack("<I", len(text)) + _JSON + text
    yield struct.pack("<I", offset) + _BIN
    for data, _ in blocks:
        yield data


def _linear(colours: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(V, 4) from sRGB, with nothing transparent."""
    table = np.arange(256) / 255.0
    table = np.where(table <= 0.04045, table / 12.92, ((table + 0.055) / 1.055) ** 2.4)
    opaque = np.full((len(colours), 1), 255, np.uint8)
    return np.hstack([np.rint(255.0 * table).astype(np.uint8)[colours], opaque])
