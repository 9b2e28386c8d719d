"""The camera: from a point to its pixel and from a pixel to its ray."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats, Matrix3, Pixels, Points, Rays

_UNDISTORT_STEPS = 20


@dataclass(frozen=True, eq=False, slots=True)
class CameraIntrinsics:
    """A pinhole with Brown's distortion, as OpenCV's `calibrateCamera` estimates it.

    Attributes:
        matrix: (3, 3) with fx, fy, cx, cy in pixels.
        distortion: (5,) k1, k2, p1, p2, k3.
        size: width and height of the picture in pixels.
    """

    matrix: Matrix3
    distortion: Floats
    size: tuple[int, int]

    def project(self, points: Points) -> Pixels:
        """Pixels (N, 2) of points (N, 3) in the camera frame; NaN for points behind the lens."""
        z = np.where(points[:, 2] > 0.0, points[:, 2], np.nan)
        x, y = self._distort(points[:, 0] / z, points[:, 1] / z)
        m = self.matrix
        return np.column_stack([m[0, 0] * x + m[0, 2], m[1, 1] * y + m[1, 2]])

    def rays(self, pixels: Pixels) -> Rays:
        """Rays (N, 3) with z = 1 through pixels (N, 2), distortion taken out (paper, equation 2)."""
        m = self.matrix
        x_seen = (pixels[:, 0] - m[0, 2]) / m[0, 0]
        y_seen = (pixels[:, 1] - m[1, 2]) / m[1, 1]
        x, y = x_seen.copy(), y_seen.copy()
        # Newton's method on the distortion; a fixed-point iteration does not converge for wide lenses.
        for _ in range(_UNDISTORT_STEPS):
            x_now, y_now = self._distort(x, y)
            ex, ey = x_now - x_seen, y_now - y_seen
            if float(np.max(np.abs(ex), initial=0.0)) + float(np.max(np.abs(ey), initial=0.0)) < 1e-13:
                break
            a, b, c = self._distortion_jacobian(x, y)
            det = a * c - b * b
            x = x - (c * ex - b * ey) / det
            y = y - (a * ey - b * ex) / det
        return np.column_stack([x, y, np.ones_like(x)])

    def _distort(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        k1, k2, p1, p2, k3 = self.distortion
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        return (
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        )

    def _distortion_jacobian(self, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
        """dx'/dx, dx'/dy (= dy'/dx) and dy'/dy."""
        k1, k2, p1, p2, k3 = self.distortion
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        slope = 2.0 * (k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3))
        return (
            radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x,
            slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y,
            radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x,
        )


@dataclass(frozen=True, eq=False, slots=True)
class RayTable:
    """The rays of one camera, computed once per pixel, so that a stripe costs an interpolation.

    Bilinear between pixel centres; the rays differ from `CameraIntrinsics.rays` by what the distortion
    bends within one pixel.

    Attributes:
        rays: (height, width, 2) x and y of the ray with z = 1, float32.
    """

    rays: NDArray[np.float32]
    # x + iy of every pixel, so that a corner is one number to fetch.
    _flat: NDArray[np.complex64] = field(repr=False)

    @classmethod
    def of(cls, camera: CameraIntrinsics) -> "RayTable":
        width, height = camera.size
        u, v = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
        rays = camera.rays(np.column_stack([u.ravel(), v.ravel()]))[:, :2].astype(np.float32)
        return cls(rays.reshape(height, width, 2), rays.view(np.complex64).ravel())

    def at(self, pixels: Pixels) -> NDArray[np.float32]:
        """x and y (N, 2) of the rays through sub-pixel positions (N, 2) inside the picture."""
        height, width = self.rays.shape[:2]
        u, v = pixels[:, 0], pixels[:, 1]
        u0 = np.minimum(np.maximum(u.astype(np.intp), 0), width - 2)
        v0 = np.minimum(np.maximum(v.astype(np.intp), 0), height - 2)
        du, dv = (u - u0).astype(np.float32), (v - v0).astype(np.float32)
        first = v0 * width + u0
        # A stripe's points lie on whole rows, or on whole columns: then two corners will do.
        if not dv.any():
            between = self._between(first, first + 1, du)
        elif not du.any():
            between = self._between(first, first + width, dv)
        else:
            upper = self._between(first, first + 1, du)
            first += width
            between = upper + (self._between(first, first + 1, du) - upper) * dv
        return between.view(np.float32).reshape(-1, 2)

    def _between(
        self, first: NDArray[np.intp], second: NDArray[np.intp], share: NDArray[np.float32]
    ) -> NDArray[np.complex64]:
        start = self._flat.take(first)
        between = self._flat.take(second)
        between -= start
        between *= share
        between += start
        return between
