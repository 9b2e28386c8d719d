"""Rotation matrices as viser wants them."""

import math
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Matrix3
from app.geometry.transform import rvec_from_rotation, skew

Quaternion: TypeAlias = tuple[float, float, float, float]


def quaternion(rotation: Matrix3) -> Quaternion:
    """w, x, y, z of a rotation matrix."""
    rvec = rvec_from_rotation(rotation)
    angle = float(np.linalg.norm(rvec))
    if angle < 1e-12:
        return 1.0, 0.0, 0.0, 0.0
    x, y, z = (float(part) for part in rvec / angle * math.sin(angle / 2.0))
    return math.cos(angle / 2.0), x, y, z


def rotation_of(wxyz: Sequence[float] | NDArray[np.floating]) -> Matrix3:
    """The rotation matrix of w, x, y, z."""
    w, x, y, z = (float(part) for part in wxyz)
    across = skew(np.array([x, y, z]))
    rotation: Matrix3 = np.eye(3) + 2.0 * w * across + 2.0 * across @ across
    return rotation


def turned(angle_rad: float) -> Quaternion:
    """w, x, y, z of a turn about z, counter-clockwise seen from above."""
    return math.cos(angle_rad / 2.0), 0.0, 0.0, math.sin(angle_rad / 2.0)
