"""Two calibrations of one scanner: what has changed, and what that means in millimetres at the object."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace

import numpy as np

from app.calibration.ball import BallChange, ball_changes, ball_middle
from app.calibration.record import CalibrationRecord
from app.documents import Json
from app.errors import CalibrationFileError
from app.geometry.arrays import Pixels, Vector3
from app.geometry.axis import TurntableAxis
from app.geometry.camera import CameraIntrinsics
from app.geometry.plane import LaserPlane

_ON_AN_EDGE = 41
_NAN = float("nan")
_SIZE_HINT = (
    "Only calibrations for the same pictures can be compared. One of Horus or FabScanPi can be imported "
    "again for pictures that are turned otherwise: see `turnscan calibrations import --help`."
)


@dataclass(frozen=True, slots=True)
class CameraChange:
    """Second minus first.

    Attributes:
        focal_px: of the focal lengths along columns and rows.
        focal_percent: of their mean.
        centre_px: how far the principal point has moved.
        edge_px: by how much distortion shifts the pixel of the picture's edge that differs most.
    """

    focal_px: tuple[float, float]
    focal_percent: float
    centre_px: float
    edge_px: float


@dataclass(frozen=True, slots=True)
class PlaneChange:
    """Of one laser.

    Attributes:
        angle_deg: between the planes.
        at_axis_mm: how far the second plane lies from the first where that passes the axis at the object;
            NaN without an axis.
    """

    angle_deg: float
    at_axis_mm: float


@dataclass(frozen=True, slots=True)
class AxisChange:
    """Of the table.

    Attributes:
        shift_mm: distance of the axes at the object.
        tilt_deg: angle between them.
        table_mm: how much higher the second table lies; NaN where one of them is unknown.
    """

    shift_mm: float
    tilt_deg: float
    table_mm: float


@dataclass(frozen=True, slots=True)
class Comparison:
    """What the second calibration has changed.

    Attributes:
        camera: the camera.
        lasers: planes that both have, by name.
        axis: the axis; None unless both have one.
        ball: what it means at the object, by laser; of those that see the ball.
        only_first, only_second: names of lasers that the other does not know.
    """

    camera: CameraChange
    lasers: Mapping[str, PlaneChange]
    axis: AxisChange | None
    ball: Mapping[str, BallChange]
    only_first: tuple[str, ...]
    only_second: tuple[str, ...]

    @property
    def bent_mm(self) -> float:
        """RMS over all lasers by which a scan changes its shape; NaN where the ball is not seen."""
        if not self.ball:
            return _NAN
        points = np.array([change.points for change in self.ball.values()])
        squares = np.array([change.bent_mm**2 for change in self.ball.values()])
        return math.sqrt(float(points @ squares / points.sum()))

    def as_json(self) -> Json:
        """For programs; what is unknown is null."""
        return {name: _without_nan(value) for name, value in asdict(self).items()} | {
            "bent_mm": _without_nan(self.bent_mm)
        }


def compare(first: CalibrationRecord, second: CalibrationRecord) -> Comparison:
    """What the second calibration has changed.

    Raises:
        CalibrationFileError: they are for pictures of different size.
    """
    if first.camera.size != second.camera.size:
        sizes = [f"{width} x {height}" for width, height in (second.camera.size, first.camera.size)]
        raise CalibrationFileError(
            second.source, f"is for pictures of {sizes[0]}, and the other for {sizes[1]}", _SIZE_HINT
        )
    names = [name for name in first.lasers if name in second.lasers]
    middle = None if first.axis is None else ball_middle(first.axis)
    axis, ball = None, {}
    if first.axis is not None and second.axis is not None:
        axis = _axis_change(first.axis, second.axis)
        if names:
            ball = ball_changes(first.rig, second.rig, names)
    return Comparison(
        camera=_camera_change(first.camera, second.camera),
        lasers={name: _plane_change(first.lasers[name], second.lasers[name], middle) for name in names},
        axis=axis,
        ball=ball,
        only_first=tuple(name for name in first.lasers if name not in second.lasers),
        only_second=tuple(name for name in second.lasers if name not in first.lasers),
    )


def _camera_change(first: CameraIntrinsics, second: CameraIntrinsics) -> CameraChange:
    here, there = np.diag(first.matrix)[:2], np.diag(second.matrix)[:2]
    edge = _edge(first.size)
    shifts = [_shift(camera, edge) for camera in (first, second)]
    return CameraChange(
        focal_px=(float(there[0] - here[0]), float(there[1] - here[1])),
        focal_percent=100.0 * float(there.mean() / here.mean() - 1.0),
        centre_px=float(np.linalg.norm(second.matrix[:2, 2] - first.matrix[:2, 2])),
        edge_px=float(np.linalg.norm(shifts[1] - shifts[0], axis=1).max()),
    )


def _edge(size: tuple[int, int]) -> Pixels:
    """Pixels all along the edge of a picture, corners included."""
    width, height = size[0] - 1.0, size[1] - 1.0
    along = np.linspace(0.0, 1.0, _ON_AN_EDGE)
    none, all_ = np.zeros(_ON_AN_EDGE), np.ones(_ON_AN_EDGE)
    sides = [(along, none), (along, all_), (none, along), (all_, along)]
    return np.concatenate([np.column_stack([u * width, v * height]) for u, v in sides])


def _shift(camera: CameraIntrinsics, pixels: Pixels) -> Pixels:
    """By how much distortion moves what a camera without it would show at these pixels."""
    straight = replace(camera, distortion=np.zeros(5))
    return camera.project(straight.rays(pixels)) - pixels


def _plane_change(first: LaserPlane, second: LaserPlane, middle: Vector3 | None) -> PlaneChange:
    at_axis = _NAN
    if middle is not None:
        foot = middle - first.signed_distance(middle[None])[0] * first.normal
        at_axis = float(second.signed_distance(foot[None])[0])
    return PlaneChange(_angle_deg(first.normal, second.normal), at_axis)


def _axis_change(first: TurntableAxis, second: TurntableAxis) -> AxisChange:
    middle = ball_middle(first)
    aside = middle - second.point_mm
    aside = aside - (aside @ second.direction) * second.direction
    # NaN if one of the tables is unknown.
    known = first.offset_mm + second.offset_mm
    table = (second.origin - first.origin) @ first.direction if np.isfinite(known) else _NAN
    return AxisChange(
        float(np.linalg.norm(aside)), _angle_deg(first.direction, second.direction), float(table)
    )


def _angle_deg(first: Vector3, second: Vector3) -> float:
    # Exact for small angles too, as the arc cosine is not.
    sine, cosine = np.linalg.norm(np.cross(first, second)), first @ second
    return math.degrees(math.atan2(float(sine), float(cosine)))


def _without_nan(value: object) -> object:
    if isinstance(value, dict):
        return {key: _without_nan(inner) for key, inner in value.items()}
    return None if isinstance(value, float) and math.isnan(value) else value
