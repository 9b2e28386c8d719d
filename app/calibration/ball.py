"""What two calibrations of one scanner make of a ball on the table."""

import math
from dataclasses import dataclass, replace

import numpy as np

from app.geometry.arrays import Matrix3, Pixels, Points, Vector3
from app.geometry.axis import TurntableAxis
from app.geometry.rig import Rig

BALL_RADIUS_MM = 30.0
_STOPS = 12
_AROUND = 144
_NAN = float("nan")


@dataclass(frozen=True, slots=True)
class BallChange:
    """Points of one laser on a ball of 60 mm that stands on the middle of the table, all around; RMS.

    Attributes:
        moved_mm: from where the first puts them to where the second does, each in its own scan frame.
        bent_mm: what is left of that after the two scans, all lasers together, were laid onto each other.
        points: how many pixels of one stop were looked at.
    """

    moved_mm: float
    bent_mm: float
    points: int


def ball_middle(axis: TurntableAxis) -> Vector3:
    """The middle of the ball; without a table, the axis point nearest the middle of the picture."""
    if np.isfinite(axis.offset_mm):
        return axis.origin + BALL_RADIUS_MM * axis.direction
    d = axis.direction
    across = np.array([d[0], d[1], 0.0])
    middle: Vector3 = axis.point_mm - d * float(axis.point_mm @ across) / max(float(across @ across), 1e-12)
    return middle


def ball_changes(first: Rig, second: Rig, names: list[str]) -> dict[str, BallChange]:
    """Of the lasers of these names, those that see the ball where the first rig has it."""
    middle = ball_middle(first.axis)
    if not np.isfinite(first.axis.offset_mm + second.axis.offset_mm):
        # Both scan frames are then counted from the axis points nearest the camera.
        first, second = (replace(rig, axis=replace(rig.axis, offset_mm=_NAN)) for rig in (first, second))
    pairs: dict[str, tuple[Points, Points]] = {}
    for name in names:
        pixels = _ball_pixels(first, name, middle)
        angles = np.linspace(0.0, 2.0 * np.pi, _STOPS, endpoint=False)
        here, there = (
            np.concatenate([rig.triangulate(pixels, name, angle) for angle in angles])
            for rig in (first, second)
        )
        is_there = np.isfinite(here).all(axis=1) & np.isfinite(there).all(axis=1)
        if np.any(is_there):
            pairs[name] = here[is_there], there[is_there]
    if not pairs:
        return {}
    all_here, all_there = (np.concatenate([pair[k] for pair in pairs.values()]) for k in (0, 1))
    rotation, shift = _laid_onto(all_there, all_here)
    return {
        name: BallChange(
            moved_mm=_rms(there - here),
            bent_mm=_rms(there @ rotation.T + shift - here),
            points=len(here) // _STOPS,
        )
        for name, (here, there) in pairs.items()
    }


def _ball_pixels(rig: Rig, laser: str, middle: Vector3) -> Pixels:
    """Where the laser's line on the ball is seen: (N, 2) px. The ball looks the same at every table angle."""
    plane = rig.lasers[laser]
    off = float(plane.signed_distance(middle[None])[0])
    if abs(off) >= BALL_RADIUS_MM:
        return np.zeros((0, 2))
    radius = math.sqrt(BALL_RADIUS_MM**2 - off**2)
    across = np.linalg.svd(plane.normal[None])[2][1:]
    turn = np.linspace(0.0, 2.0 * np.pi, _AROUND, endpoint=False)
    circle = radius * np.column_stack([np.cos(turn), np.sin(turn)]) @ across
    points = middle - off * plane.normal + circle
    faces_camera = np.sum((points - middle) * points, axis=1) < 0.0
    pixels = rig.camera.project(points[faces_camera])
    width, height = rig.camera.size
    return pixels[np.all((pixels >= 0.0) & (pixels <= [width - 1.0, height - 1.0]), axis=1)]


def _laid_onto(moving: Points, still: Points) -> tuple[Matrix3, Vector3]:
    """Rotation and shift that lay points onto others with the least squares: Kabsch."""
    middles = moving.mean(axis=0), still.mean(axis=0)
    left, _, right = np.linalg.svd((still - middles[1]).T @ (moving - middles[0]))
    hand = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    rotation = left @ hand @ right
    return rotation, middles[1] - rotation @ middles[0]


def _rms(differences: Points) -> float:
    return math.sqrt(float(np.mean(np.sum(differences**2, axis=1))))
