"""Markers on the table tell its angle: one angle from a known layout, and the layout from many pictures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats, Pixels, Points
from app.geometry.axis import TurntableAxis
from app.geometry.camera import CameraIntrinsics

MarkerLayout: TypeAlias = Mapping[int, Points]
"""Corners (4, 3) of every marker by its number, mm, table frame (so: at table angle 0)."""
SeenMarkers: TypeAlias = Mapping[int, Pixels]
"""Corners (4, 2) of the markers in one picture by their number."""

_ANGLE_STEPS = 30
_LAYOUT_STEPS = 40
# A corner further off than this many times the typical residual hardly counts.
_CAUCHY = 2.5
_SMALLEST_SCALE_PX = 0.1
_TURN_STEP = 1e-5
_MOVE_STEP_MM = 1e-3


class MarkerAngle(NamedTuple):
    """Angle of the table in one picture.

    Attributes:
        angle_rad: right-handed about the axis, -pi..pi; NaN where no known marker was seen.
        rms_px: of the corners that were used, distance to where the layout has them.
    """

    angle_rad: float
    rms_px: float


@dataclass(frozen=True, eq=False, slots=True)
class LayoutFit:
    """A layout of markers found from one turn of the table.

    Attributes:
        layout: where the markers lie.
        angles_rad: (F,) of every picture, as close to the nominal ones as a common turn allows; NaN where no
            marker was seen.
        rms_px: of all corners, outliers damped.
    """

    layout: MarkerLayout
    angles_rad: Floats
    rms_px: float


def angle_from_markers(
    camera: CameraIntrinsics, axis: TurntableAxis, layout: MarkerLayout, seen: SeenMarkers
) -> MarkerAngle:
    """The one angle that brings the layout onto the corners: robust Gauss-Newton on the reprojection.

    Args:
        layout: where the markers lie; seen markers that it does not know are ignored.
        seen: corners in one picture, in the same order as the layout has them.
    """
    known = [number for number in seen if number in layout]
    if not known:
        return MarkerAngle(float("nan"), float("nan"))
    points = np.concatenate([layout[number] for number in known])
    pixels = np.concatenate([seen[number] for number in known])
    angle = _start_angle(camera, axis, points, pixels)
    weights = np.ones(len(points))
    for _ in range(_ANGLE_STEPS):
        residuals = _turned(camera, axis, points, angle) - pixels
        weights = _cauchy_weights(residuals)
        slope = (_turned(camera, axis, points, angle + _TURN_STEP) - pixels - residuals) / _TURN_STEP
        step = -float(np.sum(weights[:, None] * slope * residuals)) / float(
            np.sum(weights[:, None] * slope * slope)
        )
        if not np.isfinite(step):
            return MarkerAngle(float("nan"), float("nan"))
        angle += float(np.clip(step, -0.2, 0.2))
        if abs(step) < 1e-7:
            break
    errors = np.linalg.norm(_turned(camera, axis, points, angle) - pixels, axis=1)
    return MarkerAngle(_wrapped(angle), float(np.sqrt(np.average(errors**2, weights=weights))))


def solve_layout(
    camera: CameraIntrinsics, axis: TurntableAxis, views: Sequence[SeenMarkers], nominal_rad: Floats
) -> LayoutFit:
    """Where the markers lie and the true angle of every view: bundle adjustment with camera and axis fixed.

    Every corner is a free point, so neither the markers' size nor their flatness is assumed.

    Args:
        views: what each picture shows.
        nominal_rad: (F,) roughly known angles; some degrees of error do no harm.

    Raises:
        ValueError: no marker was seen at three angles that differ.
    """
    frame, corner, pixels, numbers = _flattened(views, nominal_rad)
    points = _triangulated(camera, axis, frame, corner, pixels, nominal_rad, len(numbers) * 4)
    angles = np.array(nominal_rad, np.float64)
    damping = 1e-6
    for _ in range(_LAYOUT_STEPS):
        residuals, by_point, by_angle = _linearised(camera, axis, points[corner], angles[frame], pixels)
        weights = _cauchy_weights(residuals)
        new_points, new_angles = _stepped(
            points, angles, frame, corner, residuals, by_point, by_angle, weights, damping
        )
        moved = _project_at(camera, axis, new_points[corner], new_angles[frame]) - pixels
        now = float(np.sum(weights[:, None] * residuals**2))
        cost = float(np.sum(weights[:, None] * moved**2))
        if not cost < now:
            damping *= 10.0
            if damping > 1e3:
                break
            continue
        points, angles, damping = new_points, new_angles, max(damping / 10.0, 1e-9)
        if now - cost < 1e-9 * now:
            break
    return _finished(camera, axis, points, angles, frame, corner, pixels, numbers, nominal_rad)


def _finished(
    camera: CameraIntrinsics, axis: TurntableAxis, points: Points, angles: Floats,
    frame: NDArray[np.intp], corner: NDArray[np.intp], pixels: Pixels, numbers: list[int], nominal: Floats,
) -> LayoutFit:  # fmt: skip
    residuals = _project_at(camera, axis, points[corner], angles[frame]) - pixels
    weights = _cauchy_weights(residuals)
    rms = float(np.sqrt(np.average(np.sum(residuals**2, axis=1), weights=weights)))
    is_seen = np.zeros(len(angles), np.bool_)
    is_seen[frame] = True
    # Only differences of angles can be seen; the common turn is the one most frames agree with.
    common = float(np.median(_wrapped_all(angles[is_seen] - nominal[is_seen])))
    cosine, sine = np.cos(common), np.sin(common)
    turned = points @ np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    layout = {number: turned[4 * k : 4 * k + 4] for k, number in enumerate(numbers)}
    return LayoutFit(layout, np.where(is_seen, angles - common, np.nan), rms)


def _flattened(
    views: Sequence[SeenMarkers], nominal: Floats
) -> tuple[NDArray[np.intp], NDArray[np.intp], Pixels, list[int]]:
    """Frame, corner and pixel of every observation, of markers seen at three angles or more."""
    angles_of: dict[int, set[float]] = {}
    for view, angle in zip(views, nominal, strict=True):
        for number in view:
            angles_of.setdefault(number, set()).add(round(float(angle), 4))
    numbers = sorted(number for number, angles in angles_of.items() if len(angles) >= 3)
    if not numbers:
        raise ValueError("no marker was seen at three different angles")
    frames, corners, pixels = [], [], []
    for index, view in enumerate(views):
        for number in view.keys() & set(numbers):
            frames.append(np.full(4, index))
            corners.append(4 * numbers.index(number) + np.arange(4))
            pixels.append(view[number])
    return np.concatenate(frames), np.concatenate(corners), np.concatenate(pixels), numbers


def _triangulated(
    camera: CameraIntrinsics, axis: TurntableAxis, frame: NDArray[np.intp], corner: NDArray[np.intp],
    pixels: Pixels, angles: Floats, count: int,
) -> Points:  # fmt: skip
    """Points (count, 3) nearest to all their rays, each ray turned back by its angle."""
    table_from_camera = axis.camera_from_table.inverse()
    rays = camera.rays(pixels) @ table_from_camera.rotation.T
    unit_rays = rays / np.sqrt(np.sum(rays**2, axis=1, keepdims=True))
    directions = _turned_about_z(unit_rays, -angles[frame])
    start = np.broadcast_to(table_from_camera.translation, rays.shape)
    centres = _turned_about_z(start, -angles[frame])
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    matrix, right = np.zeros((count, 3, 3)), np.zeros((count, 3))
    np.add.at(matrix, corner, across)
    np.add.at(right, corner, np.einsum("nij,nj->ni", across, centres))
    solved = np.linalg.solve(matrix + 1e-12 * np.eye(3), right[:, :, None])
    points: Points = np.asarray(solved[:, :, 0], np.float64)
    return points


def _linearised(
    camera: CameraIntrinsics, axis: TurntableAxis, points: Points, angles: Floats, pixels: Pixels
) -> tuple[Floats, Floats, Floats]:
    """Residuals (N, 2), their slopes by the point (N, 2, 3) and by the angle (N, 2)."""
    here = _project_at(camera, axis, points, angles)
    by_point = np.stack(
        [
            (_project_at(camera, axis, points + _MOVE_STEP_MM * side, angles) - here) / _MOVE_STEP_MM
            for side in np.eye(3)
        ],
        axis=2,
    )
    by_angle = (_project_at(camera, axis, points, angles + _TURN_STEP) - here) / _TURN_STEP
    return here - pixels, by_point, by_angle


def _stepped(
    points: Points, angles: Floats, frame: NDArray[np.intp], corner: NDArray[np.intp], residuals: Floats,
    by_point: Floats, by_angle: Floats, weights: Floats, damping: float,
) -> tuple[Points, Floats]:  # fmt: skip
    """One Levenberg-Marquardt step over all points and angles; the points are eliminated first."""
    n_points, n_angles = len(points), len(angles)
    weighted = weights[:, None, None] * by_point
    pp, gp = np.zeros((n_points, 3, 3)), np.zeros((n_points, 3))
    np.add.at(pp, corner, np.einsum("nki,nkj->nij", weighted, by_point))
    np.add.at(gp, corner, np.einsum("nki,nk->ni", weighted, residuals))
    aa = np.bincount(frame, weights * np.sum(by_angle**2, axis=1), n_angles)
    ga = np.bincount(frame, weights * np.sum(by_angle * residuals, axis=1), n_angles)
    ap = np.zeros((n_angles, n_points, 3))
    np.add.at(ap, (frame, corner), np.einsum("nki,nk->ni", weighted, by_angle))
    pp += damping * np.eye(3) * np.trace(pp, axis1=1, axis2=2)[:, None, None] + 1e-12 * np.eye(3)
    inverse = np.linalg.inv(pp)
    shares = np.einsum("api,pij->apj", ap, inverse).reshape(n_angles, -1)
    # A frame without markers has an empty row; its angle stays.
    diagonal = np.where(aa > 0.0, aa * (1.0 + damping), 1.0)
    reduced = np.diag(diagonal) - shares @ ap.reshape(n_angles, -1).T
    # The common turn cannot be seen; a faint pull on every angle holds it.
    reduced += 1e-9 * float(diagonal.max()) * np.eye(n_angles)
    step_angles = np.linalg.solve(reduced, -ga + shares @ gp.ravel())
    step_points = -np.einsum("pij,pj->pi", inverse, gp + np.einsum("api,a->pi", ap, step_angles))
    return points + step_points, angles + step_angles


def _start_angle(camera: CameraIntrinsics, axis: TurntableAxis, points: Points, pixels: Pixels) -> float:
    """In closed form: the rays meet each point's height; the turn that fits the plan best."""
    table_from_camera = axis.camera_from_table.inverse()
    rays = camera.rays(pixels) @ table_from_camera.rotation.T
    centre = table_from_camera.translation
    seen = centre + rays * ((points[:, 2] - centre[2]) / rays[:, 2])[:, None]
    cross = points[:, 0] * seen[:, 1] - points[:, 1] * seen[:, 0]
    dot = points[:, 0] * seen[:, 0] + points[:, 1] * seen[:, 1]
    # Corner by corner, so that one wrong marker does not spoil the mean.
    turns = np.arctan2(cross, dot)
    middle = float(np.arctan2(np.sum(cross), np.sum(dot)))
    return middle + float(np.median(_wrapped_all(turns - middle)))


def _turned(camera: CameraIntrinsics, axis: TurntableAxis, points: Points, angle: float) -> Pixels:
    return _project_at(camera, axis, points, np.full(len(points), angle))


def _project_at(camera: CameraIntrinsics, axis: TurntableAxis, points: Points, angles: Floats) -> Pixels:
    """Pixels (N, 2) of table points (N, 3), each at its own table angle (N,)."""
    return camera.project(axis.camera_from_table @ _turned_about_z(points, angles))


def _turned_about_z(points: Points, angles: Floats) -> Points:
    cosine, sine = np.cos(angles), np.sin(angles)
    x, y = points[:, 0], points[:, 1]
    return np.column_stack([cosine * x - sine * y, sine * x + cosine * y, points[:, 2]])


def _cauchy_weights(residuals: Floats) -> Floats:
    """(N,) weights of residuals (N, 2); the scale is measured from their median."""
    errors = np.linalg.norm(residuals, axis=1)
    scale = _CAUCHY * max(float(np.nanmedian(errors)), _SMALLEST_SCALE_PX)
    weights: Floats = 1.0 / (1.0 + (np.nan_to_num(errors, nan=1e6) / scale) ** 2)
    return weights


def _wrapped(angle: float) -> float:
    return float(np.arctan2(np.sin(angle), np.cos(angle)))


def _wrapped_all(angles: Floats) -> Floats:
    wrapped: Floats = np.arctan2(np.sin(angles), np.cos(angles))
    return wrapped
