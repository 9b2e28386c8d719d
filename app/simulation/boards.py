"""Printed planes: calibration boards, and the table with its markers."""

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats, Points
from app.geometry.transform import RigidTransform
from app.simulation.mesh import Mesh, plain_mesh
from app.simulation.scene import Body, Texture
from app.simulation.swept import lathe
from app.vision.board import BoardSpec
from app.vision.markers import PlatterSpec, aruco_dictionary

BOARD_MARGIN_MM = 8.0
_WHITE, _INK = 0.86, 0.05
_TEXEL_MM = 0.1
# Each texel is the mean of as many squared, so that edges between texels lie where they should.
_FINER = 5
_PLATE_MM = 2.0
_TABLE_THICKNESS_MM = 6.0
TABLE_ALBEDO = 0.22


def board_body(
    spec: BoardSpec, pose: RigidTransform, turns: bool, margin_mm: float = BOARD_MARGIN_MM
) -> Body:
    """A board on a white plate.

    Args:
        spec: what is printed.
        pose: where it is: camera from board, or, on the table, table from board. x along the board's rows,
            y from row to row, z into the board, origin at its first corner.
        turns: whether it stands on the table and turns with it.
        margin_mm: white border beyond the printed pattern.
    """
    outline = spec.outline(margin_mm)
    texture = _board_texture(spec, margin_mm)
    return Body(_plate(outline[0, :2], outline[2, :2]), pose, turns, texture)


def board_plate(spec: BoardSpec, margin_mm: float = BOARD_MARGIN_MM) -> Points:
    """Corners (4, 3) of the plate that the board is printed on, in the board's frame, mm."""
    return spec.outline(margin_mm)


def table_bodies(radius_mm: float, platter: PlatterSpec | None) -> tuple[Body, Body]:
    """The table's top, which turns where it has markers, and its rim; both in the table frame."""
    top = lathe(np.array([[radius_mm, 0.0], [0.0, 0.0]]), (TABLE_ALBEDO,) * 3)
    rim = lathe(np.array([[radius_mm, -_TABLE_THICKNESS_MM], [radius_mm, 0.0]]), (0.3, 0.3, 0.3))
    where = RigidTransform.identity()
    texture = None if platter is None else _platter_texture(platter, radius_mm)
    return Body(top, where, True, texture, is_round=True), Body(rim, where, False)


def platter_poses(platter: PlatterSpec, radius_mm: float) -> tuple[RigidTransform, ...]:
    """Table from marker for each marker on the rim: x along its upper edge, y down it, origin its middle."""
    ring = radius_mm - 0.95 * platter.marker_mm
    poses = []
    for number in range(len(platter.ids)):
        # Not evenly spread: nothing may depend on it.
        turn = 2.0 * np.pi * (number + 0.13 * np.sin(2.7 * number)) / len(platter.ids)
        out = np.array([np.cos(turn), np.sin(turn), 0.0])
        down = np.array([0.0, 0.0, -1.0])
        x = np.cross(out, down)
        poses.append(RigidTransform(np.column_stack([x, out, np.cross(x, out)]), ring * out))
    return tuple(poses)


@lru_cache(maxsize=4)
def _board_texture(spec: BoardSpec, margin_mm: float) -> Texture:
    outline = spec.outline(margin_mm)[:, :2]
    origin, end = outline[0], outline[2]
    shape = tuple(np.ceil((end - origin) / _TEXEL_MM).astype(int)[::-1])
    is_ink = np.empty(shape, np.float32)
    for first in range(0, shape[0], 64):
        rows = range(first, min(first + 64, shape[0]))
        fine = (np.arange(rows.start * _FINER, rows.stop * _FINER) + 0.5) * (_TEXEL_MM / _FINER)
        across = (np.arange(shape[1] * _FINER) + 0.5) * (_TEXEL_MM / _FINER)
        x, y = np.meshgrid(across + origin[0], fine + origin[1])
        ink = _is_ink(spec, x, y).reshape(len(rows), _FINER, shape[1], _FINER)
        is_ink[rows.start : rows.stop] = ink.mean(axis=(1, 3))
    return Texture.of((_WHITE + (_INK - _WHITE) * is_ink).astype(np.float32), origin, _TEXEL_MM)


def _is_ink(spec: BoardSpec, x: Floats, y: Floats) -> NDArray[np.bool_]:
    """Whether places on the board are black; the square before the first corner is, on a chessboard."""
    if spec.kind in ("circles", "asymmetric_circles"):
        return _is_dot(spec, x, y)
    rows, columns = spec.shape
    column, row = np.floor(x / spec.spacing_mm).astype(int), np.floor(y / spec.spacing_mm).astype(int)
    is_inside = (column >= -1) & (column < columns) & (row >= -1) & (row < rows)
    is_black: NDArray[np.bool_] = is_inside & ((column + row) % 2 == 0)
    if spec.kind == "charuco":
        cells = _marker_cells(spec)
        size = spec.marker_mm / cells.shape[2]
        inset = (spec.spacing_mm - spec.marker_mm) / 2.0
        i = np.floor((y - row * spec.spacing_mm - inset) / size).astype(int)
        j = np.floor((x - column * spec.spacing_mm - inset) / size).astype(int)
        on_cell = is_inside & ~is_black & (i >= 0) & (j >= 0) & (i < cells.shape[2]) & (j < cells.shape[2])
        is_black[on_cell] = cells[row[on_cell] + 1, column[on_cell] + 1, i[on_cell], j[on_cell]]
    return is_black


def _is_dot(spec: BoardSpec, x: Floats, y: Floats) -> NDArray[np.bool_]:
    step = spec.spacing_mm
    row = np.clip(np.rint(y / step), 0, spec.rows - 1)
    if spec.kind == "circles":
        across, apart = np.clip(np.rint(x / step), 0, spec.columns - 1), step
    else:
        shift = row % 2
        across = 2.0 * np.clip(np.rint((x / step - shift) / 2.0), 0, spec.columns - 1) + shift
        apart = step * np.sqrt(2.0)
    is_black: NDArray[np.bool_] = np.hypot(x - across * step, y - row * step) < 0.25 * apart
    return is_black


def _marker_cells(spec: BoardSpec) -> NDArray[np.bool_]:
    """Cells (rows, columns, n, n) of the marker in every white square, false in the black ones."""
    dictionary = aruco_dictionary(spec.dictionary)
    board = cv2.aruco.CharucoBoard((spec.columns, spec.rows), spec.spacing_mm, spec.marker_mm, dictionary)
    side = dictionary.markerSize + 2
    cells = np.zeros((spec.rows, spec.columns, side, side), np.bool_)
    for number, corners in zip(np.ravel(board.getIds()), board.getObjPoints(), strict=True):
        column, row = (np.asarray(corners)[:, :2].mean(axis=0) / spec.spacing_mm).astype(int)
        cells[row, column] = _cells(dictionary, int(number))
    return cells


def _cells(dictionary: cv2.aruco.Dictionary, number: int) -> NDArray[np.bool_]:
    """A marker with its border, one value per cell, true where black."""
    cells = dictionary.markerSize + 2
    drawn = np.asarray(cv2.aruco.generateImageMarker(dictionary, number, cells, borderBits=1))
    is_black: NDArray[np.bool_] = drawn < 128
    return is_black


@lru_cache(maxsize=4)
def _platter_texture(platter: PlatterSpec, radius_mm: float) -> Texture:
    count = int(np.ceil(2.0 * radius_mm / _TEXEL_MM))
    origin = np.array([-radius_mm, -radius_mm])
    albedo = np.full((count, count), TABLE_ALBEDO, np.float32)
    dictionary = aruco_dictionary(platter.dictionary)
    for number, pose in zip(platter.ids, platter_poses(platter, radius_mm), strict=True):
        cells = _cells(dictionary, number)
        size = platter.marker_mm / len(cells)
        reach = 1.3 * platter.marker_mm
        low = np.maximum(((pose.translation[:2] - reach - origin) / _TEXEL_MM).astype(int), 0)
        high = np.minimum(((pose.translation[:2] + reach - origin) / _TEXEL_MM).astype(int), count)
        fine = [
            (np.arange(low[n] * _FINER, high[n] * _FINER) + 0.5) * (_TEXEL_MM / _FINER) + origin[n]
            for n in (0, 1)
        ]
        x, y = np.meshgrid(fine[0] - pose.translation[0], fine[1] - pose.translation[1])
        along = x * pose.rotation[0, 0] + y * pose.rotation[1, 0]
        down = x * pose.rotation[0, 1] + y * pose.rotation[1, 1]
        half = platter.marker_mm / 2.0
        # A white border of two cells: what lies beyond must not disturb the corners.
        is_label = np.maximum(np.abs(along), np.abs(down)) < half + 2.0 * size
        i, j = np.floor((down + half) / size).astype(int), np.floor((along + half) / size).astype(int)
        is_cell = (i >= 0) & (j >= 0) & (i < len(cells)) & (j < len(cells))
        is_black = is_cell & cells[np.clip(i, 0, len(cells) - 1), np.clip(j, 0, len(cells) - 1)]
        painted = np.where(is_black, _INK, np.where(is_label, _WHITE, np.nan))
        part = (slice(low[1], high[1]), slice(low[0], high[0]))
        under = np.repeat(np.repeat(albedo[part], _FINER, axis=0), _FINER, axis=1)
        fresh = np.where(np.isnan(painted), under, painted)
        rows, columns = albedo[part].shape
        albedo[part] = fresh.reshape(rows, _FINER, columns, _FINER).mean(axis=(1, 3))
    return Texture.of(albedo, origin, _TEXEL_MM)


def _plate(low: Floats, high: Floats) -> Mesh:
    """The front of a board at z = 0, facing -z, and its back; cut fine enough for any lens."""
    fronts = _grid(low, high, 0.0, is_front=True)
    backs = _grid(low, high, _PLATE_MM, is_front=False)
    return Mesh.joined([fronts, backs])


def _grid(low: Floats, high: Floats, z: float, is_front: bool) -> Mesh:
    count = np.maximum(np.ceil((high - low) / 10.0).astype(int), 1)
    x, y = np.linspace(low[0], high[0], count[0] + 1), np.linspace(low[1], high[1], count[1] + 1)
    vertices = np.stack([*np.meshgrid(x, y), np.full((count[1] + 1, count[0] + 1), z)], axis=-1)
    row, column = np.meshgrid(np.arange(count[1]), np.arange(count[0]), indexing="ij")
    a = (row * (count[0] + 1) + column).ravel()
    b, c = a + 1, a + count[0] + 1
    d = c + 1
    faces = np.concatenate([np.column_stack([a, c, b]), np.column_stack([b, c, d])])
    if not is_front:
        faces = faces[:, ::-1]
    return plain_mesh(vertices.reshape(-1, 3), faces.astype(np.int32), (_WHITE,) * 3)
