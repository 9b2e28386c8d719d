"""Pictures of printed boards with known corners."""

from dataclasses import dataclass

import cv2
import numpy as np

from app.calibration.board_print import draw_board
from app.calibration.drawing import BoardDrawing, Disk, Rectangle
from app.geometry.arrays import Floats, Pixels
from app.geometry.camera import CameraIntrinsics
from app.geometry.transform import RigidTransform, rotation_from_rvec
from app.vision.board import BoardSpec
from app.vision.stripe import Image

PAPER, INK = 215.0, 25.0
_PER_MM, _SUB = 8, 4


@dataclass(frozen=True, eq=False)
class Scene:
    """A picture of a board and the pixels of all its corners."""

    image: Image
    corners: Pixels


def camera(size: tuple[int, int] = (640, 480), focal: float = 700.0) -> CameraIntrinsics:
    matrix = np.array([[focal, 0.0, size[0] / 2 - 3.3], [0.0, focal, size[1] / 2 + 4.1], [0.0, 0.0, 1.0]])
    return CameraIntrinsics(matrix, np.zeros(5), size)


def pose(spec: BoardSpec, tilt: tuple[float, float, float], depth_mm: float) -> RigidTransform:
    """The board's middle straight ahead; tilt: a rotation vector's x and y, then the roll, degrees."""
    outline = spec.outline()
    tilted = rotation_from_rvec(np.radians([tilt[0], tilt[1], 0.0]))
    rotation = tilted @ rotation_from_rvec(np.radians([0.0, 0.0, tilt[2]]))
    return RigidTransform(rotation, np.array([0.0, 0.0, depth_mm]) - rotation @ outline.mean(axis=0))


def picture(
    spec: BoardSpec,
    tilt: tuple[float, float, float] = (25.0, -20.0, 5.0),
    depth_mm: float = 450.0,
    seen_by: CameraIntrinsics | None = None,
    noise: float = 2.0,
) -> Scene:
    """A grey picture of the board on a grey ground, slightly blurred and noisy."""
    eye = seen_by or camera()
    stands = pose(spec, tilt, depth_mm)
    sheet, left_top = _sheet(spec)
    pixel_from_board = eye.matrix @ np.column_stack([stands.rotation[:, :2], stands.translation])
    light = seen_through(sheet, pixel_from_board @ _scaled(1.0 / _PER_MM, left_top), eye.size)
    light = np.asarray(cv2.GaussianBlur(light, (0, 0), 0.7), np.float64)
    return Scene(noisy(light, noise), eye.project(stands @ spec.points()))


def seen_through(sheet: Image, pixel_from_sheet: Floats, size: tuple[int, int]) -> Floats:
    """The sheet in a picture of that size: each pixel the mean of sub-pixels, on a grey ground.

    Args:
        sheet: blurred a little beforehand, so that no edge falls between two sub-pixels.
        pixel_from_sheet: homography from the sheet's continuous coordinates (0 at its edge) to pixels whose
            first has its centre at (0, 0).
        size: width and height.
    """
    to_fine = (
        _scaled(float(_SUB), np.full(2, 0.5 * _SUB - 0.5)) @ pixel_from_sheet @ _scaled(1.0, np.full(2, 0.5))
    )
    fine_size = (size[0] * _SUB, size[1] * _SUB)
    smooth = cv2.GaussianBlur(sheet, (0, 0), 1.5)
    fine = cv2.warpPerspective(smooth, to_fine, fine_size, flags=cv2.INTER_LINEAR, borderValue=130)
    return np.asarray(cv2.resize(fine, size, interpolation=cv2.INTER_AREA), np.float64)


def _scaled(scale: float, shift: Floats) -> Floats:
    return np.array([[scale, 0.0, shift[0]], [0.0, scale, shift[1]], [0.0, 0.0, 1.0]])


def noisy(light: Floats, noise: float) -> Image:
    grains = np.random.default_rng(7).normal(0.0, noise, light.shape)
    return np.clip(np.rint(light + grains), 0, 255).astype(np.uint8)


def _sheet(spec: BoardSpec) -> tuple[Image, Floats]:
    """The printed pattern with a white border, and where its top left lies on the board, mm."""
    drawing = draw_board(spec)
    border = spec.spacing_mm
    left, top, width, height = drawing.pattern
    sheet = rasterised(
        drawing, _PER_MM, (left - border, top - border, width + 2 * border, height + 2 * border)
    )
    return sheet, spec.outline()[0, :2] - border


def rasterised(drawing: BoardDrawing, per_mm: int, window: tuple[float, float, float, float]) -> Image:
    """The shapes in a window (left, top, width, height in mm), without the text and the ruler."""
    left, top, width, height = window
    sheet = np.full((round(height * per_mm), round(width * per_mm)), PAPER, np.uint8)
    v, u = np.mgrid[0 : sheet.shape[0], 0 : sheet.shape[1]] + 0.5
    for shape in drawing.shapes:
        x, y = (shape.x_mm - left) * per_mm, (shape.y_mm - top) * per_mm
        if shape.y_mm >= drawing.ruler[1] - 0.2:
            continue
        if isinstance(shape, Rectangle):
            right, bottom = round(x + shape.width_mm * per_mm), round(y + shape.height_mm * per_mm)
            sheet[round(y) : bottom, round(x) : right] = INK
        elif isinstance(shape, Disk):
            radius = shape.radius_mm * per_mm
            rows = slice(max(0, int(y - radius) - 1), int(y + radius) + 2)
            columns = slice(max(0, int(x - radius) - 1), int(x + radius) + 2)
            inside = (u[rows, columns] - x) ** 2 + (v[rows, columns] - y) ** 2 < radius**2
            sheet[rows, columns][inside] = INK
    return sheet
