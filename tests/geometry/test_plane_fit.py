from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from rig_strategies import directions

from app.geometry.arrays import Floats
from app.geometry.plane import LaserPlane, fit_plane, fit_plane_robust
from app.surface.ply_reader import read_ply


def points_on(normal: Floats, distance: float, seed: int, count: int = 60) -> Floats:
    rng = np.random.default_rng(seed)
    inside = np.linalg.svd(normal[None])[2][1:]
    points: Floats = rng.uniform(-80.0, 80.0, (count, 2)) @ inside + distance * normal
    return points


@given(directions(), st.floats(-400.0, 400.0), st.integers(0, 1000))
def test_points_of_a_plane_give_it_back(normal: Floats, distance: float, seed: int) -> None:
    points = points_on(normal, distance, seed)
    fit = fit_plane(points)
    assert_allclose(fit.residuals, 0.0, atol=1e-9)
    assert fit.plane.normal[2] >= 0.0
    assert_allclose(abs(fit.plane.normal @ normal), 1.0, atol=1e-12)


@settings(max_examples=25)
@given(directions(), st.floats(-400.0, 400.0), st.integers(0, 50))
def test_a_third_of_wrong_points_does_not_move_the_robust_plane(
    normal: Floats, distance: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    points = points_on(normal, distance, seed, 120) + rng.normal(0.0, 0.02, (120, 3))
    points[:40] += rng.uniform(20.0, 60.0, (40, 1)) * normal
    fit = fit_plane_robust(points)
    assert abs(fit.plane.normal @ normal) > np.cos(np.radians(0.1))
    assert fit.is_inlier[40:].mean() > 0.9
    assert not fit.is_inlier[:40].any()


@given(directions(), st.floats(1.0, 300.0))
def test_a_ray_meets_the_plane_on_the_plane(normal: Floats, distance: float) -> None:
    plane = LaserPlane.through(distance * normal, normal)
    rays = np.column_stack([np.random.default_rng(0).uniform(-0.5, 0.5, (30, 2)), np.ones(30)])
    met = plane.intersect_rays(rays)
    known = np.isfinite(met).all(axis=1)
    assert_allclose(
        plane.signed_distance(met[known]), 0.0, atol=1e-6 * (1.0 + np.abs(met[known]).max(initial=0))
    )
    assert (met[known, 2] > 0.0).all()


@pytest.mark.parametrize("points", [np.zeros((2, 3)), np.outer(np.arange(9.0), [1.0, 2.0, 3.0])])
def test_too_few_points_and_a_line_span_no_plane(points: Floats) -> None:
    with pytest.raises(ValueError, match="plane"):
        fit_plane_robust(points)


def test_the_published_laser_plane_comes_out_of_its_points(shared_data: Path) -> None:
    cloud = read_ply(shared_data / "ciclop" / "laser-plane-points.ply")
    fit = fit_plane(cloud.points.astype(np.float64))
    assert len(cloud) == 5975
    assert_allclose(fit.plane.normal, [0.85110861, -0.00122944, 0.52498829], atol=2e-6)
    assert_allclose(fit.plane.distance_mm, 159.526931763, atol=2e-4)
    assert_allclose(np.std(fit.residuals), 0.0884, atol=1e-4)
