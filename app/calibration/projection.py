"""Brown's camera and its derivatives, many points at once, for the bundle adjustment.

The camera here is a vector of nine: fx, fy, cx, cy, k1, k2, p1, p2, k3.
"""

import numpy as np

from app.geometry.arrays import Floats, Points
from app.geometry.camera import CameraIntrinsics

CAMERA_NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")


def vector_from_camera(camera: CameraIntrinsics) -> Floats:
    m = camera.matrix
    return np.array([m[0, 0], m[1, 1], m[0, 2], m[1, 2], *camera.distortion])


def camera_from_vector(vector: Floats, size: tuple[int, int]) -> CameraIntrinsics:
    fx, fy, cx, cy = vector[:4]
    return CameraIntrinsics(
        np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]), vector[4:].copy(), size
    )


def distort(camera: Floats, xy: Floats) -> tuple[Floats, Floats, Floats]:
    """Distorted coordinates of (N, 2) normalised ones, and their derivatives.

    Returns:
        (N, 2) distorted; (N, 2, 2) by the undistorted; (N, 2, 5) by k1, k2, p1, p2, k3.
    """
    k1, k2, p1, p2, k3 = camera[4:]
    x, y = xy[:, 0], xy[:, 1]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2.0 * (k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3))
    seen = np.column_stack(
        [
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        ]
    )
    by_xy = np.empty((len(x), 2, 2))
    by_xy[:, 0, 0] = radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x
    by_xy[:, 0, 1] = by_xy[:, 1, 0] = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y
    by_xy[:, 1, 1] = radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x
    by_k = np.empty((len(x), 2, 5))
    for row, c in enumerate((x, y)):
        by_k[:, row, 0] = c * r2
        by_k[:, row, 1] = c * r2 * r2
        by_k[:, row, 4] = c * r2**3
    by_k[:, 0, 2] = by_k[:, 1, 3] = 2.0 * x * y
    by_k[:, 0, 3] = r2 + 2.0 * x * x
    by_k[:, 1, 2] = r2 + 2.0 * y * y
    return seen, by_xy, by_k


def project(camera: Floats, points: Points) -> tuple[Floats, Floats, Floats]:
    """Pixels of points in the camera frame, and their derivatives.

    Returns:
        (N, 2) pixels; (N, 2, 3) by the point; (N, 2, 9) by the camera.
    """
    inverse_z = 1.0 / points[:, 2]
    xy = points[:, :2] * inverse_z[:, None]
    seen, by_xy, by_k = distort(camera, xy)
    focal = camera[:2]
    xy_by_point = np.zeros((len(points), 2, 3))
    xy_by_point[:, 0, 0] = xy_by_point[:, 1, 1] = inverse_z
    xy_by_point[:, :, 2] = -xy * inverse_z[:, None]
    by_point = (focal[:, None] * by_xy) @ xy_by_point
    return seen * focal + camera[2:4], by_point, _by_camera(focal, seen, by_k)


def rays_with_derivatives(
    camera: Floats, size: tuple[int, int], pixels: Floats
) -> tuple[Floats, Floats, Floats]:
    """Rays through pixels, and how they move with the pixel and with the camera.

    The pixel is held while the camera changes, so the ray moves against what the projection would.

    Returns:
        (N, 3) rays with z = 1; (N, 2, 2) x and y by the pixel; (N, 2, 9) x and y by the camera.
    """
    rays = camera_from_vector(camera, size).rays(pixels)
    seen, by_xy, by_k = distort(camera, rays[:, :2])
    focal = camera[:2]
    by_pixel = np.asarray(np.linalg.inv(focal[:, None] * by_xy), np.float64)
    return rays, by_pixel, -by_pixel @ _by_camera(focal, seen, by_k)


def _by_camera(focal: Floats, seen: Floats, by_k: Floats) -> Floats:
    by_camera = np.zeros((len(seen), 2, 9))
    by_camera[:, 0, 0], by_camera[:, 1, 1] = seen[:, 0], seen[:, 1]
    by_camera[:, 0, 2] = by_camera[:, 1, 3] = 1.0
    by_camera[:, :, 4:] = focal[:, None] * by_k
    return by_camera
