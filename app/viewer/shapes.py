"""Lines and sheets of the scene as plain arrays, mm, table frame."""

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Points, Vector3
from app.geometry.plane import LaserPlane
from app.geometry.transform import RigidTransform
from app.viewer.digits import strokes
from app.vision.board import BoardSpec
from app.vision.stripe import Image

# Lines on the table, not in it.
_ABOVE_MM = 0.15


def degree_ticks(radius_mm: float) -> NDArray[np.float32]:
    """(72, 2, 3) a line every 5 degrees inside the rim of the table, longer at 15 and longest at 45."""
    lines = []
    for degree in range(0, 360, 5):
        share = 0.13 if degree % 45 == 0 else 0.08 if degree % 15 == 0 else 0.04
        along = np.array([math.cos(math.radians(degree)), math.sin(math.radians(degree)), 0.0])
        lines.append([along * radius_mm * (1.0 - share), along * radius_mm])
    ticks = np.asarray(lines, np.float32)
    ticks[:, :, 2] = _ABOVE_MM
    return ticks


def degree_numbers(radius_mm: float) -> NDArray[np.float32]:
    """(N, 2, 3) the degrees every 45, to be read from outside the table."""
    lines = []
    for degree in range(0, 360, 45):
        flat = strokes(degree) * (0.022 * radius_mm)
        angle = math.radians(degree)
        outward = np.array([math.cos(angle), math.sin(angle)])
        right = np.array([-outward[1], outward[0]])
        placed = flat[..., :1] * right + (0.8 * radius_mm - flat[..., 1:]) * outward
        lines.append(np.concatenate([placed, np.full((*placed.shape[:2], 1), _ABOVE_MM)], axis=2))
    return np.concatenate(lines).astype(np.float32)


def circle(radius_mm: float, segments: int = 96) -> NDArray[np.float32]:
    """(N, 2, 3) the rim as line segments."""
    angles = np.linspace(0.0, 2.0 * np.pi, segments + 1)
    rim = np.column_stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)]) * radius_mm
    rim[:, 2] = _ABOVE_MM
    return np.stack([rim[:-1], rim[1:]], axis=1).astype(np.float32)


def sheet(plane: LaserPlane, world_from_camera: RigidTransform, radius_mm: float, height_mm: float) -> Points:
    """(N, 3) outline of a laser plane in the box over the table; no rows where it passes beside it."""
    normal = world_from_camera.rotation @ plane.normal
    distance = plane.distance_mm + float(normal @ world_from_camera.translation)
    corners = np.array(
        list(itertools.product((-radius_mm, radius_mm), (-radius_mm, radius_mm), (0.0, height_mm)))
    )
    beyond = corners @ normal - distance
    met = []
    for first, second in itertools.combinations(range(8), 2):
        is_edge = np.count_nonzero(corners[first] != corners[second]) == 1
        if is_edge and (beyond[first] < 0.0) != (beyond[second] < 0.0):
            share = beyond[first] / (beyond[first] - beyond[second])
            met.append(corners[first] + share * (corners[second] - corners[first]))
    if len(met) < 3:
        return np.zeros((0, 3))
    return _walked(np.array(met), normal)


def _walked(points: Points, normal: Vector3) -> Points:
    """Corners of a convex polygon in the order of a walk around it."""
    from_middle = points - points.mean(axis=0)
    first = from_middle[0] / np.linalg.norm(from_middle[0])
    second = np.cross(normal, first)
    return points[np.argsort(np.arctan2(from_middle @ second, from_middle @ first))]


def fan(corners: int) -> NDArray[np.uint32]:
    """(N - 2, 3) triangles of a convex polygon."""
    return np.array([[0, k, k + 1] for k in range(1, corners - 1)], np.uint32)


def board_picture(spec: BoardSpec, cell_px: int = 10) -> Image:
    """(H, W, 3) what a board looks like from afar; markers are left out."""
    if spec.kind in ("chessboard", "charuco"):
        extra = 1 if spec.kind == "chessboard" else 0
        rows, columns = spec.rows + extra, spec.columns + extra
        row, column = np.indices((rows * cell_px, columns * cell_px)) // cell_px
        ink = (row + column) % 2 == 0
    else:
        low, high = spec.outline()[0, :2], spec.outline()[2, :2]
        steps = np.maximum(((high - low) / spec.spacing_mm * cell_px).astype(int), 1)
        x = low[0] + (np.arange(steps[0]) + 0.5) * spec.spacing_mm / cell_px
        y = low[1] + (np.arange(steps[1]) + 0.5) * spec.spacing_mm / cell_px
        ink = np.zeros((steps[1], steps[0]), np.bool_)
        for dot in spec.points():
            ink |= (x - dot[0]) ** 2 + (y[:, None] - dot[1]) ** 2 < (0.3 * spec.spacing_mm) ** 2
    return np.repeat(np.where(ink, 40, 225).astype(np.uint8)[:, :, None], 3, axis=2)
