"""Pieces of stripe, and smoothing that stays inside them."""

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from app.geometry.arrays import Floats
from app.vision.segments import has_company, noise_scale, segments_of, smooth_within


def test_a_missing_line_and_a_step_both_end_a_piece() -> None:
    line = np.array([0, 1, 2, 4, 5, 6, 7, 8, 9, 10])
    across = np.array([5.0, 5.1, 5.2, 5.3, 5.4, 5.5, 9.0, 9.1, 9.2, 9.3])
    assert_array_equal(segments_of(line, across), [0, 0, 0, 1, 1, 1, 2, 2, 2, 2])


def test_a_steep_stripe_is_one_piece() -> None:
    line = np.arange(50)
    across: Floats = np.linspace(0.0, 170.0, 50)
    assert_array_equal(segments_of(line, across), np.zeros(50))


def test_points_without_neighbours_have_no_company() -> None:
    line = np.array([0, 1, 2, 3, 40, 80, 81])
    across = np.array([10.0, 10.5, 11.0, 11.5, 30.0, 20.0, 90.0])
    assert_array_equal(has_company(line, across), [True, True, True, True, False, False, False])


def test_smoothing_keeps_a_slope_and_does_not_cross_a_step() -> None:
    line = np.arange(40)
    across: Floats = np.linspace(0.0, 11.7, 40) + np.where(line < 20, 0.0, 8.0)
    segment = segments_of(line, across)
    smooth, variance = smooth_within(line, across, np.full(40, 0.01), segment, 7)
    assert_allclose(smooth, across, atol=1e-9)
    assert_allclose(variance[5:15], 0.01 / 7.0)
    assert (variance[:20] <= 0.01).all()


def test_smoothing_trusts_certain_points_more() -> None:
    line = np.arange(21)
    across = np.zeros(21)
    across[10] = 3.0
    variance = np.full(21, 0.01)
    variance[10] = 100.0
    smooth, _ = smooth_within(line, across, variance, np.zeros(21, np.intp), 5)
    assert np.abs(smooth).max() < 0.01


def test_roughness_tells_how_wrong_the_variances_are() -> None:
    rng = np.random.default_rng(0)
    across = 100.0 + 0.2 * np.arange(2000) + rng.normal(0.0, 0.3, 2000)
    segment = np.zeros(2000, np.intp)
    assert_allclose(noise_scale(across, np.full(2000, 0.09), segment), 1.0, atol=0.15)
    assert_allclose(noise_scale(across, np.full(2000, 0.01), segment), 9.0, rtol=0.15)
    assert noise_scale(across[:20], np.full(20, 0.01), segment[:20]) == 1.0


def test_nothing_in_nothing_out() -> None:
    none, whole = np.zeros(0), np.zeros(0, np.intp)
    assert len(segments_of(whole, none)) == 0
    assert len(has_company(whole, none)) == 0
    assert len(smooth_within(whole, none, none, whole, 7)[0]) == 0
