"""Noise with the distribution it claims, and stripes with the centres they claim."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.errors import OptionError
from app.simulation.noise import Noise, normal_levels, speckle_levels, stripe_image


def test_normal_levels_have_mean_zero_and_variance_one() -> None:
    levels = normal_levels().astype(np.float64)

    assert abs(levels.mean()) < 1e-6
    assert levels.var() == pytest.approx(1.0, abs=1e-3)


@settings(max_examples=15, deadline=None)
@given(contrast=st.floats(0.02, 1.0))
def test_speckle_has_mean_one_and_its_contrast(contrast: float) -> None:
    levels = speckle_levels(contrast).astype(np.float64)

    assert levels.mean() == pytest.approx(1.0, abs=1e-5)
    assert levels.std() == pytest.approx(contrast, rel=0.01)
    assert levels.min() >= 0.0


def test_no_speckle_is_no_factor() -> None:
    assert (speckle_levels(0.0) == 1.0).all()


@given(start=st.floats(30.0, 60.0), slope=st.floats(-0.5, 0.5), sigma=st.floats(0.8, 4.0))
def test_a_stripe_has_its_centre_of_gravity_where_it_says(start: float, slope: float, sigma: float) -> None:
    centres = start + slope * np.arange(20, dtype=np.float64)
    lit, dark = stripe_image(centres, 100, sigma, 180.0)
    light = lit.astype(np.float64) - dark
    found = (light @ np.arange(100)) / light.sum(axis=1)

    assert np.abs(found - centres).max() < 0.06


def test_a_row_without_centre_has_no_stripe() -> None:
    lit, dark = stripe_image(np.array([50.0, np.nan]), 100)

    assert lit[0].max() > 150
    assert (lit[1] == dark[1]).all()


def test_the_same_seed_gives_the_same_stripe() -> None:
    centres = np.full(50, 40.3)
    pairs = [stripe_image(centres, 90, noise=Noise(0.2, 20.0, 1.0), seed=seed)[0] for seed in (1, 1, 2)]

    assert (pairs[0] == pairs[1]).all()
    assert (pairs[0] != pairs[2]).any()


@pytest.mark.parametrize("bad", [(-0.1, 10.0, 0.0), (1.2, 10.0, 0.0), (0.1, 0.0, 0.0), (0.1, 5.0, -1.0)])
def test_noise_that_cannot_be_is_refused(bad: tuple[float, float, float]) -> None:
    with pytest.raises(OptionError):
        Noise(*bad)
