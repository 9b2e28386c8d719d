"""The table is the lowest flat ring, wherever the frame's origin lies."""

import numpy as np
import pytest

from app.scanning.find_table import find_table


def disc(radius: float, height: float, count: int, rng: np.random.Generator) -> np.ndarray:
    distance, angle = radius * np.sqrt(rng.uniform(size=count)), rng.uniform(0.0, 2.0 * np.pi, count)
    z = height + 0.05 * rng.normal(size=count)
    return np.column_stack([distance * np.cos(angle), distance * np.sin(angle), z]).astype(np.float32)


def wall(radius: float, low: float, high: float, count: int, rng: np.random.Generator) -> np.ndarray:
    angle, z = rng.uniform(0.0, 2.0 * np.pi, count), rng.uniform(low, high, count)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z]).astype(np.float32)


@pytest.mark.parametrize("height", [-146.9, -3.0, 0.0, 77.7])
def test_the_table_is_found_under_an_object_and_above_its_own_rim(height: float) -> None:
    rng = np.random.default_rng(3)
    cloud = np.vstack(
        [
            disc(75.0, height, 20_000, rng),
            wall(75.0, height - 12.0, height, 4_000, rng),
            wall(30.0, height, height + 60.0, 20_000, rng),
            disc(30.0, height + 60.0, 8_000, rng),
        ]
    )
    assert find_table(cloud) == pytest.approx(height, abs=0.1)


def test_a_wall_alone_is_no_table() -> None:
    cloud = wall(40.0, -80.0, 80.0, 30_000, np.random.default_rng(1))
    assert np.isnan(find_table(cloud))


def test_no_points_show_no_table() -> None:
    assert np.isnan(find_table(np.zeros((0, 3), np.float32)))
