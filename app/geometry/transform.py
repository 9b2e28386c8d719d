"""Rigid motions, named by both frames with the target first: `camera_from_board @ points`."""

from dataclasses import dataclass
from typing import Self, overload

import numpy as np

from app.geometry.arrays import Matrix3, Points, Vector3, unit


def skew(vector: Vector3) -> Matrix3:
    """The matrix whose product with w is the cross product vector x w."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation_about(direction: Vector3, angle_rad: float) -> Matrix3:
    """Rodrigues' formula: right-handed rotation about a unit vector."""
    k = skew(direction)
    rotation: Matrix3 = np.eye(3) + np.sin(angle_rad) * k + (1.0 - np.cos(angle_rad)) * (k @ k)
    return rotation


def rotation_from_rvec(rvec: Vector3) -> Matrix3:
    """Rotation matrix of a rotation vector (axis times angle)."""
    angle = float(np.linalg.norm(rvec))
    if angle < 1e-12:
        return np.eye(3) + skew(rvec)
    return rotation_about(np.asarray(rvec, np.float64) / angle, angle)


def rvec_from_rotation(rotation: Matrix3) -> Vector3:
    """Rotation vector of a rotation matrix, angle in 0..pi."""
    antisymmetric: Vector3 = np.array(
        [
            rotation[2, 1] - rotation[1, 2],
            rotation[0, 2] - rotation[2, 0],
            rotation[1, 0] - rotation[0, 1],
        ]
    )
    sine, cosine = np.linalg.norm(antisymmetric) / 2.0, (np.trace(rotation) - 1.0) / 2.0
    angle = float(np.arctan2(sine, cosine))
    if sine > 1e-6:
        scaled: Vector3 = antisymmetric / (2.0 * sine) * angle
        return scaled
    if cosine > 0.0:
        return antisymmetric / 2.0
    # Half a turn: the axis is the column of R + I that is longest.
    symmetric = rotation + np.eye(3)
    column = symmetric[:, int(np.argmax(np.linalg.norm(symmetric, axis=0)))]
    axis = unit(column)
    return axis * angle if axis @ antisymmetric >= 0.0 else -axis * angle


@dataclass(frozen=True, eq=False, slots=True)
class RigidTransform:
    """x -> rotation @ x + translation.

    Attributes:
        rotation: (3, 3) orthonormal, determinant one.
        translation: (3,) mm.
    """

    rotation: Matrix3
    translation: Vector3

    @classmethod
    def identity(cls) -> Self:
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_rvec(cls, rvec: Vector3, translation: Vector3) -> Self:
        """From a rotation vector, as OpenCV's pose functions give it."""
        return cls(
            rotation_from_rvec(np.asarray(rvec, np.float64).ravel()),
            np.asarray(translation, np.float64).ravel(),
        )

    @property
    def rvec(self) -> Vector3:
        return rvec_from_rotation(self.rotation)

    def inverse(self) -> "RigidTransform":
        return RigidTransform(self.rotation.T, -self.rotation.T @ self.translation)

    @overload
    def __matmul__(self, other: "RigidTransform") -> "RigidTransform": ...
    @overload
    def __matmul__(self, other: Points) -> Points: ...
    def __matmul__(self, other: "RigidTransform | Points") -> "RigidTransform | Points":
        """Another transform after which this one comes, or (N, 3) points to move."""
        if isinstance(other, RigidTransform):
            return RigidTransform(
                self.rotation @ other.rotation, self.rotation @ other.translation + self.translation
            )
        return other @ self.rotation.T + self.translation
