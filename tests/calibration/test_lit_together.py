"""Stripes of two lasers from one picture go to the laser whose plane they lie on."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from app.calibration.lit_together import swapped_pairs
from app.geometry.arrays import Points
from app.geometry.plane import LaserPlane

_LEFT = LaserPlane.through(np.array([0.0, 0.0, 300.0]), np.array([-0.87, 0.0, 0.5]))
_RIGHT = LaserPlane.through(np.array([0.0, 0.0, 300.0]), np.array([0.87, 0.0, 0.5]))


def _stripe(plane: LaserPlane, depth_mm: float, rng: np.random.Generator) -> Points:
    y = np.linspace(-40.0, 40.0, 60)
    z = depth_mm + 0.3 * y
    x = (plane.distance_mm - plane.normal[2] * z) / plane.normal[0]
    return np.column_stack([x, y, z]) + rng.normal(size=(60, 3)) * 0.05


def _as_seen(depths: list[float], seed: int) -> tuple[list[tuple[Points, Points]], list[bool]]:
    """Pairs as a picture gives them, from left to right, and whether that is the wrong way round."""
    rng = np.random.default_rng(seed)
    pairs, wrong = [], []
    for depth in depths:
        left, right = _stripe(_LEFT, depth, rng), _stripe(_RIGHT, depth, rng)
        is_behind = bool(left[:, 0].mean() > right[:, 0].mean())
        pairs.append((right, left) if is_behind else (left, right))
        wrong.append(is_behind)
    return pairs, wrong


@pytest.mark.parametrize("depths", [[250.0, 270.0, 330.0, 350.0], [340.0, 330.0, 260.0], [320.0, 340.0]])
def test_boards_on_both_sides_of_the_crossing_are_told_apart(depths: list[float]) -> None:
    pairs, wrong = _as_seen(depths, 4)
    assert_array_equal(swapped_pairs(pairs, 0), wrong)


def test_one_view_alone_is_taken_as_it_is_listed() -> None:
    pairs, _ = _as_seen([260.0], 1)
    assert_array_equal(swapped_pairs(pairs, 0), [False])


def test_one_view_of_nonsense_does_not_mislead_the_others() -> None:
    pairs, wrong = _as_seen([250.0, 265.0, 340.0, 355.0, 330.0], 2)
    rng = np.random.default_rng(9)
    pairs.insert(
        2, (rng.normal(size=(60, 3)) * 40.0 + [0, 0, 300], rng.normal(size=(60, 3)) * 40.0 + [9, 0, 310])
    )
    swapped = swapped_pairs(pairs, 0)
    assert_array_equal(np.delete(swapped, 2), wrong)
