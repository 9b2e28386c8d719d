"""Clouds for tests."""

import numpy as np

from app.geometry.cloud import PointCloud


def some_cloud(count: int, seed: int = 0) -> PointCloud:
    rng = np.random.default_rng(seed)
    normals = rng.normal(0.0, 1.0, (count, 3)).astype(np.float32)
    return PointCloud(
        rng.normal(0.0, 40.0, (count, 3)).astype(np.float32),
        normals / np.linalg.norm(normals, axis=1, keepdims=True),
        rng.integers(0, 256, (count, 3), dtype=np.uint8),
        rng.uniform(0.01, 0.2, count).astype(np.float32),
        rng.integers(0, 2, count, dtype=np.uint8),
        rng.uniform(0.0, 360.0, count).astype(np.float32),
        rng.uniform(0.0, 1.0, count).astype(np.float32),
        ("left", "right side"),
    )


def assert_same(found: PointCloud, expected: PointCloud) -> None:
    for name in ("points", "normals", "colours", "sigma_mm", "laser", "angle_deg", "quality"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), err_msg=name)
    assert found.laser_names == expected.laser_names
