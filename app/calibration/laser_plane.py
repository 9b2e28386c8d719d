"""The plane of a laser from stripes on boards: rays meet board planes, robust, then SVD (paper, 3 to 6)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.errors import CalibrationError
from app.geometry.arrays import Floats, Points
from app.geometry.plane import LaserPlane, fit_plane, fit_plane_robust

_OBJECT_DEPTH_MM = 50.0
_TOLERATED_MM = 0.2
_FEWEST_POSES = 3
_POINTS_OF_POSE = 400


@dataclass(frozen=True, eq=False, slots=True)
class LaserPlaneResult:
    """A laser's plane and how far the views determine it.

    Attributes:
        plane: in the camera frame.
        rms_mm: of the points that were used, to the plane.
        pose_rms_mm: (P,) of each pose.
        share_used: of the points that the robust fit kept, 0..1.
        predicted_mm: how far the plane may be off, 50 mm before or behind the middle of the views.
        warnings: plain sentences.
    """

    plane: LaserPlane
    rms_mm: float
    pose_rms_mm: Floats
    share_used: float
    predicted_mm: float
    warnings: tuple[str, ...]


def solve_laser_plane(laser: str, poses: Sequence[Points], *, robust: bool = True) -> LaserPlaneResult:
    """Plane through the stripe's points on several board poses.

    Args:
        laser: its name, for messages.
        poses: for each board pose (N, 3) points in the camera frame, mm.
        robust: throw away points that do not lie with the majority (the paper does not), and let every pose
            count the same. Of two poses neither is the majority, so all their points are used.

    Raises:
        CalibrationError: fewer than two poses show the laser, or all its points lie on one line.
    """
    if len(poses) < 2:
        seen = "one pose" if poses else "no pose"
        raise CalibrationError(
            f"The laser {laser!r} was seen on the board in {seen}; its plane needs two at the very least.",
            "Take views with the stripe across the board, at several distances.",
        )
    try:
        if robust and len(poses) >= _FEWEST_POSES:
            fit = fit_plane_robust(_evened(poses))
        else:
            fit = fit_plane(np.concatenate(poses))
    except ValueError as error:
        raise CalibrationError(f"The plane of laser {laser!r} cannot be fitted: {error}.") from error
    pose_rms = np.array([np.sqrt(np.mean(fit.plane.signed_distance(points) ** 2)) for points in poses])
    # The points of one pose share its error, so poses are counted, not points.
    tilt_rad = fit.rms_mm / max(fit.spread_mm[1], 1e-9) / np.sqrt(len(poses))
    predicted_mm = float(np.hypot(fit.rms_mm / np.sqrt(len(poses)), tilt_rad * _OBJECT_DEPTH_MM))
    warnings = []
    if len(poses) < _FEWEST_POSES:
        warnings.append(
            f"Laser {laser!r} was seen in {len(poses)} poses only, so nothing checks its plane: "
            "take four or more at different distances."
        )
    if fit.spread_mm[1] < 0.05 * fit.spread_mm[0] or predicted_mm > _TOLERATED_MM:
        warnings.append(
            f"The poses leave the plane of laser {laser!r} ill-conditioned (it may be off by "
            f"{predicted_mm:.2f} mm at {_OBJECT_DEPTH_MM:.0f} mm from their middle): "
            "hold the board nearer and farther as well."
        )
    return LaserPlaneResult(
        fit.plane,
        fit.rms_mm,
        pose_rms,
        float(np.mean(fit.is_inlier)),
        predicted_mm,
        tuple(warnings),
    )


def _evened(poses: Sequence[Points]) -> Points:
    """As many points of every pose: all points of one pose lie in its board's plane as well, and a pose
    with more than half of all points would pass that for the laser's."""
    count = min(max(len(points) for points in poses), _POINTS_OF_POSE)
    return np.concatenate([p[np.linspace(0, len(p) - 1, count).astype(np.intp)] for p in poses])
