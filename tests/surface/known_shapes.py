"""Clouds whose surface is known."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats, Points
from app.geometry.cloud import PointCloud


def cloud_of(points: Points, normals: Floats | None = None, sigma_mm: float = 0.03) -> PointCloud:
    """As a scan with one laser; without normals where none are given."""
    n = len(points)
    ones = np.ones(n, np.float32)
    normals = np.zeros((n, 3)) if normals is None else normals
    return PointCloud(
        points.astype(np.float32), normals.astype(np.float32), np.full((n, 3), 128, np.uint8),
        sigma_mm * ones, np.zeros(n, np.uint8), 0.0 * ones, ones, ("left", "right"),
    )  # fmt: skip


def ball(count: int, noise_mm: float = 0.0, radius_mm: float = 20.0, height_mm: float = 30.0) -> PointCloud:
    rng = np.random.default_rng(3)
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = normals * (radius_mm + noise_mm * rng.normal(size=(count, 1))) + [0.0, 0.0, height_mm]
    return cloud_of(points, normals, max(noise_mm, 0.001))


def stairs(count: int, noise_mm: float, step_mm: float) -> tuple[PointCloud, NDArray[np.bool_]]:
    """Two level planes 40 mm wide, and which points lie on the upper one (x > 0)."""
    rng = np.random.default_rng(4)
    points = np.column_stack([rng.uniform(-20.0, 20.0, (count, 2)), noise_mm * rng.normal(size=count)])
    is_upper = points[:, 0] > 0.0
    points[is_upper, 2] += step_mm
    return cloud_of(points, np.tile([0.0, 0.0, 1.0], (count, 1)), noise_mm), is_upper


def seen_all_around(cloud: PointCloud) -> PointCloud:
    """With the angle at which a point looked at the camera."""
    x, y, _ = cloud.normals.T
    return replace(cloud, angle_deg=(-np.degrees(np.arctan2(y, x)) % 360.0).astype(np.float32))
