"""Surfaces swept from a line: turned about an axis, or drawn along a path."""

from itertools import pairwise

import numpy as np

from app.geometry.arrays import Floats
from app.simulation.mesh import Albedo, Mesh, plain_mesh


def lathe(profile: Floats, albedo: Albedo, sections: int = 192) -> Mesh:
    """A surface of revolution about z.

    Args:
        profile: (N, 2) radius and height, mm; the outside lies to the right of the way along it.
        albedo: blue, green, red in 0..1.
        sections: facets round the turn.
    """
    turn = np.linspace(0.0, 2.0 * np.pi, sections, endpoint=False)
    radius, height = _refined(profile).T
    vertices = np.stack(
        [
            radius[:, None] * np.cos(turn),
            radius[:, None] * np.sin(turn),
            np.broadcast_to(height[:, None], (len(height), sections)),
        ],
        axis=-1,
    ).reshape(-1, 3)
    ring, step = np.meshgrid(np.arange(len(radius) - 1), np.arange(sections), indexing="ij")
    a = (ring * sections + step).ravel()
    b = (ring * sections + (step + 1) % sections).ravel()
    c, d = b + sections, a + sections
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    corners = vertices[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return plain_mesh(vertices, faces[area > 1e-9].astype(np.int32), albedo)


def _refined(profile: Floats, longest_mm: float = 6.0) -> Floats:
    pieces = []
    for start, end in pairwise(profile):
        steps = max(1, int(np.ceil(np.linalg.norm(end - start) / longest_mm)))
        pieces.append(start + (end - start) * np.arange(steps)[:, None] / steps)
    return np.concatenate([*pieces, profile[-1:]])


def tube(path: Floats, radius_mm: float, albedo: Albedo, sections: int = 24) -> Mesh:
    """A round bar along a path (N, 3) that lies in a plane of constant y, open at its hidden ends."""
    along = np.gradient(path, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    side = np.array([0.0, 1.0, 0.0])
    across = np.cross(along, side)
    turn = np.linspace(0.0, 2.0 * np.pi, sections, endpoint=False)
    ring = across[:, None, :] * np.cos(turn)[:, None] + side * np.sin(turn)[:, None]
    vertices = (path[:, None, :] + radius_mm * ring).reshape(-1, 3)
    place, step = np.meshgrid(np.arange(len(path) - 1), np.arange(sections), indexing="ij")
    a = (place * sections + step).ravel()
    b = (place * sections + (step + 1) % sections).ravel()
    faces = np.concatenate(
        [np.column_stack([a, b + sections, b]), np.column_stack([a, a + sections, b + sections])]
    )
    return plain_mesh(vertices, faces.astype(np.int32), albedo)
