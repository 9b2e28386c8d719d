import numpy as np

from app.calibration.bundle import Corners, Stripes
from app.calibration.correlation import correlation_of_groups

_STRIPES, _POINTS = 30, 96


def _stripes() -> Stripes:
    n = _STRIPES * _POINTS
    zeros = np.zeros(n, np.intp)
    body = np.repeat(np.arange(_STRIPES), _POINTS)
    return Stripes(np.zeros((n, 2)), body, zeros, zeros, zeros, np.ones(n), zeros + 1)


def _corners(count: int) -> Corners:
    zeros = np.zeros(count, np.intp)
    body = np.repeat(np.arange(count // 48), 48)
    return Corners(np.zeros((count, 2)), body, zeros, np.zeros((count, 3)), zeros, np.ones(count), zeros)


def test_independent_residuals_are_trusted_as_many_as_they_are() -> None:
    rng = np.random.default_rng(1)
    found = correlation_of_groups(rng.normal(size=2 * 960 + 2880), _corners(960), _stripes())
    assert np.all(found < 1.35)


def test_points_that_err_four_at_a_time_count_for_one_in_four() -> None:
    rng = np.random.default_rng(2)
    alike = np.repeat(rng.normal(size=_STRIPES * _POINTS // 4), 4)
    corners = rng.normal(size=2 * 960)
    found = correlation_of_groups(np.concatenate([corners, alike]), _corners(960), _stripes())
    assert 3.2 < found[1] < 4.8
    assert found[0] < 1.35


def test_outliers_do_not_pass_for_correlation() -> None:
    rng = np.random.default_rng(3)
    residuals = rng.normal(size=_STRIPES * _POINTS)
    residuals[:200] = 50.0
    assert correlation_of_groups(residuals, _corners(0), _stripes())[1] < 1.35


def test_residuals_that_swing_against_each_other_earn_no_trust() -> None:
    swinging = np.tile([1.0, -1.0], _STRIPES * _POINTS // 2)
    assert correlation_of_groups(swinging, _corners(0), _stripes())[1] == 1.0


def test_a_handful_of_observations_tells_nothing() -> None:
    few = _stripes()
    few = Stripes(*(getattr(few, name)[:40] for name in Stripes.__slots__))
    assert correlation_of_groups(np.ones(40), _corners(0), few)[1] == 1.0
