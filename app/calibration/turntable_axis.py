"""The axis of the table, in closed form: along a laser line (the paper), or from a board that turns."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.errors import CalibrationError
from app.geometry.arrays import Floats, Points, Vector3
from app.geometry.axis import TurntableAxis
from app.geometry.transform import RigidTransform, rotation_about, rvec_from_rotation

_LEAST_TURN_RAD = np.radians(2.0)
_PARTNERS = 8


@dataclass(frozen=True, eq=False, slots=True)
class AxisResult:
    """The axis and how well the views agree on it.

    Attributes:
        axis: in the camera frame; the table's plane is not known from it.
        rms_mm: of the points to the line, or of the board's centre to the circle it should run on.
        view_mm: (K,) the same for each view.
        warnings: plain sentences.
    """

    axis: TurntableAxis
    rms_mm: float
    view_mm: Floats
    warnings: tuple[str, ...]


def solve_axis_line(points: Points) -> AxisResult:
    """Straight line through the laser's points on a board that stands through the axis (paper, III C).

    Up is taken to be up in the picture.

    Args:
        points: (N, 3) mm, camera frame.

    Raises:
        CalibrationError: fewer than ten points.
    """
    if len(points) < 10:
        raise CalibrationError(
            "The laser line along the axis was not seen on the board.",
            "Stand the board on the table through its axis and aim the laser along the axis.",
        )
    centre = np.median(points, axis=0)
    keep = np.ones(len(points), np.bool_)
    off = np.zeros(len(points))
    direction = np.zeros(3)
    for _ in range(5):
        centre = points[keep].mean(axis=0)
        _, _, rows = np.linalg.svd(points[keep] - centre, full_matrices=False)
        direction = rows[0]
        off = np.linalg.norm(np.cross(points - centre, direction), axis=1)
        keep = off < 3.0 * max(float(np.sqrt(np.mean(off[keep] ** 2))), 1e-9)
    if direction[1] > 0.0:
        direction = -direction
    return AxisResult(TurntableAxis(centre, direction), float(np.sqrt(np.mean(off[keep] ** 2))), off, ())


def solve_axis_turning(
    placements: Sequence[Sequence[RigidTransform]], angles: Sequence[Floats], up: Vector3 | None = None
) -> AxisResult:
    """Axis from a body that stands on the table in one or more placements while the table turns.

    The direction is the mean axis of all relative rotations; the point solves (I - R) p = t1 - R t0 for
    all pairs with the first view (the linear solve of hand-eye calibration, Tsai and Lenz 1989).

    Args:
        placements: for each placement, the body's poses in the camera frame.
        angles: for each placement, the table's angles in rad, NaN where unknown; they tell which way is up.
        up: (3,) rough direction of up where it is known otherwise; it wins over the angles.

    Raises:
        CalibrationError: nothing turned.
    """
    vectors: list[Vector3] = []
    pairs: list[tuple[RigidTransform, RigidTransform, float]] = []
    for poses, turned in zip(placements, angles, strict=True):
        for j in range(1, len(poses)):
            # All pairs of a few views; of many, each with some partners near and far.
            for i in range(0, j, max(1, len(poses) // _PARTNERS)):
                rvec = rvec_from_rotation(poses[j].rotation @ poses[i].rotation.T)
                if np.linalg.norm(rvec) > _LEAST_TURN_RAD:
                    vectors.append(rvec)
                    pairs.append((poses[i], poses[j], float(turned[j] - turned[i])))
    if not pairs:
        raise CalibrationError(
            "The board was not seen at two angles of the table, so the axis is unknown.",
            "Turn the table between the axis pictures, ten degrees or more.",
        )
    rotations = np.array(vectors)
    # Long turns know the direction best; the sign of each vector is free until then.
    _, _, rows = np.linalg.svd(rotations, full_matrices=False)
    direction = rows[0]
    signed = rotations @ direction
    # A commanded turn beyond half a circle shows as the shorter turn the other way.
    commanded = np.array([np.arctan2(np.sin(turn), np.cos(turn)) for _, _, turn in pairs])
    known = np.isfinite(commanded) & (np.abs(commanded) < np.radians(170.0))
    vote = float(np.sum(np.sign(signed[known]) * np.sign(commanded[known]))) if known.any() else 0.0
    warnings: list[str] = []
    if up is not None:
        direction = direction if direction @ up >= 0.0 else -direction
    elif vote != 0.0:
        direction = direction * np.sign(vote)
        if direction[1] > 0.0:
            warnings.append(
                "By the recording's turning direction the table's upper side points down in the picture: "
                "check turntable.direction, or the camera is upside down."
            )
    elif direction[1] > 0.0:
        direction = -direction
    point = _axis_point(pairs, direction)
    view_mm = _off_circle(placements, point, direction)
    return AxisResult(
        TurntableAxis(point, direction),
        float(np.sqrt(np.mean(view_mm**2))),
        view_mm,
        tuple(warnings),
    )


def _axis_point(pairs: Sequence[tuple[RigidTransform, RigidTransform, float]], direction: Vector3) -> Vector3:
    """The point of the axis nearest the camera centre."""
    rows = [direction[None, :]]
    values = [np.zeros(1)]
    for first, second, _ in pairs:
        turn = second.rotation @ first.rotation.T
        angle = float(rvec_from_rotation(turn) @ direction)
        pure = rotation_about(direction, angle)
        rows.append(np.eye(3) - pure)
        values.append(second.translation - pure @ first.translation)
    solved: Vector3 = np.linalg.lstsq(np.vstack(rows), np.concatenate(values), rcond=None)[0]
    return solved - (solved @ direction) * direction


def _off_circle(placements: Sequence[Sequence[RigidTransform]], point: Vector3, direction: Vector3) -> Floats:
    """How far each view's body origin is from the circle of its placement, mm."""
    off: list[float] = []
    for poses in placements:
        origins = np.array([pose.translation for pose in poses]) - point
        height = origins @ direction
        radius = np.linalg.norm(origins - height[:, None] * direction, axis=1)
        off += list(np.hypot(height - height.mean(), radius - radius.mean()))
    return np.array(off)
