"""The stripe on the table, told from the stripe on an object."""

import numpy as np
import pytest

from app.calibration.bare_table import on_bare_table
from app.geometry.arrays import Points

NORMAL = np.array([0.85, -0.2, 0.49]) / np.linalg.norm([0.85, -0.2, 0.49])
DISTANCE_MM, FOCAL_PX = 140.0, 700.0


def on_sheet(count: int, printed: float, rng: np.random.Generator) -> Points:
    """Points of the laser's plane as they seem to lie when markers are printed at another scale."""
    spread = rng.uniform(-60.0, 60.0, (count, 3))
    points = spread - np.outer(spread @ NORMAL, NORMAL) + NORMAL * DISTANCE_MM + [0.0, 0.0, 0.0]
    points += np.outer(rng.normal(size=count) * 0.1, NORMAL)
    seeming: Points = points / printed
    return seeming


def on_object(count: int, rng: np.random.Generator) -> Points:
    """Points that seem nearer or farther by up to a quarter."""
    true = on_sheet(count, 1.0, rng)
    elsewhere: Points = true * rng.uniform(0.75, 1.25, (count, 1))
    return elsewhere


@pytest.mark.parametrize("printed", [0.95, 0.98, 1.0, 1.03])
def test_the_table_is_found_among_points_of_an_object(printed: float) -> None:
    rng = np.random.default_rng(0)
    points = np.concatenate([on_sheet(300, printed, rng), on_object(400, rng)])
    found = on_bare_table(points, NORMAL, DISTANCE_MM, FOCAL_PX)
    assert found[:300].mean() > 0.95
    assert found[300:].mean() < 0.15


def test_where_little_of_the_table_is_seen_nothing_is_taken() -> None:
    rng = np.random.default_rng(1)
    points = np.concatenate([on_sheet(20, 1.0, rng), on_object(980, rng)])
    assert not on_bare_table(points, NORMAL, DISTANCE_MM, FOCAL_PX).any()


def test_no_points_are_no_table() -> None:
    assert len(on_bare_table(np.zeros((0, 3)), NORMAL, DISTANCE_MM, FOCAL_PX)) == 0
