"""A calibration for pictures that are turned or mirrored afterwards: the same rig in another camera frame."""

from dataclasses import dataclass

import numpy as np

from app.geometry.arrays import Matrix3, Vector3
from app.geometry.camera import CameraIntrinsics
from app.geometry.plane import LaserPlane

_TRANSPOSED = np.array([[0.0, 1.0], [1.0, 0.0]])
_LEFT_FOR_RIGHT = np.diag([-1.0, 1.0])
_TOP_FOR_BOTTOM = np.diag([1.0, -1.0])
_QUARTER_CLOCKWISE = np.array([[0.0, -1.0], [1.0, 0.0]])


@dataclass(frozen=True, eq=False, slots=True)
class PictureTurn:
    """From one picture to another with the same pixels in another order.

    Attributes:
        matrix: (2, 2) of 0, 1 and -1: where a pixel goes, both counted from the middle of the picture.
    """

    matrix: Matrix3

    @classmethod
    def clockwise(cls, degrees: int, *, is_mirrored: bool = False) -> "PictureTurn":
        """Turned by a multiple of 90 degrees, then left and right exchanged, as the bench does it."""
        turn = np.linalg.matrix_power(_QUARTER_CLOCKWISE, degrees // 90 % 4)
        return cls(_LEFT_FOR_RIGHT @ turn if is_mirrored else turn)

    @classmethod
    def flipped(cls, *, is_transposed: bool, is_hflipped: bool, is_vflipped: bool) -> "PictureTurn":
        """Columns for rows, then left for right, then top for bottom, as Horus and FabScanPi do it."""
        matrix = _TRANSPOSED if is_transposed else np.eye(2)
        if is_hflipped:
            matrix = _LEFT_FOR_RIGHT @ matrix
        return cls(_TOP_FOR_BOTTOM @ matrix if is_vflipped else matrix)

    def after(self, first: "PictureTurn") -> "PictureTurn":
        return PictureTurn(self.matrix @ first.matrix)

    def inverse(self) -> "PictureTurn":
        return PictureTurn(self.matrix.T)

    @property
    def is_mirrored(self) -> bool:
        """Whether a table that turns clockwise seems to turn the other way."""
        return bool(np.linalg.det(self.matrix) < 0.0)

    def size(self, size: tuple[int, int]) -> tuple[int, int]:
        """Width and height of the other picture."""
        return size if self.matrix[0, 0] else (size[1], size[0])

    def camera(self, camera: CameraIntrinsics) -> CameraIntrinsics:
        """The camera of the other picture."""
        size = self.size(camera.size)
        middle, new_middle = (np.array(s, np.float64) / 2.0 - 0.5 for s in (camera.size, size))
        fx, fy = np.abs(self.matrix) @ np.diag(camera.matrix)[:2]
        cx, cy = self.matrix @ (camera.matrix[:2, 2] - middle) + new_middle
        k1, k2, p1, p2, k3 = camera.distortion
        # The tangential part shifts a point x by 2 (q . x) x + |x|^2 q, and q = (p2, p1) turns as x does.
        p2, p1 = self.matrix @ np.array([p2, p1])
        matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        return CameraIntrinsics(matrix, np.array([k1, k2, p1, p2, k3]), size)

    def vector(self, vector: Vector3) -> Vector3:
        """A point or a direction (3,) of the camera frame; depth stays."""
        return np.concatenate([self.matrix @ vector[:2], vector[2:]])

    def plane(self, plane: LaserPlane) -> LaserPlane:
        return LaserPlane(self.vector(plane.normal), plane.distance_mm)
