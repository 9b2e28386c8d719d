"""Each step on clouds of which the truth is known, and on clouds that nobody should have."""

from dataclasses import replace

import numpy as np
import pytest
from known_shapes import ball, cloud_of, seen_all_around, stairs

from app.errors import SurfaceError
from app.geometry.cloud import PointCloud
from app.surface import neighbours
from app.surface.laser_agreement import map_lasers
from app.surface.neighbours import Places
from app.surface.normals import with_normals
from app.surface.preview_steps import preview_steps
from app.surface.step import STEPS, parse_step


@pytest.mark.parametrize(
    "step",
    [{"kind": "statistical-outliers"}, {"kind": "radius-outliers", "radius_mm": 1.5}],
    ids=["statistical", "radius"],
)
def test_planted_outliers_go_and_the_surface_stays(step: dict[str, object]) -> None:
    good, rng = ball(20_000, 0.02), np.random.default_rng(0)
    planted = rng.uniform(-60.0, 60.0, (300, 3))
    planted = planted[np.abs(np.linalg.norm(planted - [0, 0, 30], axis=1) - 20.0) > 3.0]
    cloud = PointCloud.joined([good, cloud_of(planted), cloud_of(np.full((3, 3), np.nan))])
    kept = parse_step(step).apply(cloud)
    away = np.abs(np.linalg.norm(kept.points - [0, 0, 30], axis=1) - 20.0)
    assert np.count_nonzero(away > 3.0) <= 0.02 * len(planted)
    assert np.count_nonzero(away < 1.0) >= 0.98 * len(good)


@pytest.mark.parametrize("kind", list(STEPS))
def test_copies_of_one_point_and_points_that_are_nowhere_stop_no_step(kind: str) -> None:
    copies = cloud_of(np.tile([1.0, 2.0, 3.0], (200_000, 1)))
    lost = cloud_of(np.full((5, 3), np.nan))
    both = PointCloud.joined([copies, lost, replace(lost, laser=np.ones(5, np.uint8))])
    left = parse_step({"kind": kind}).apply(both)
    assert len(left) <= len(both)


def test_a_cloud_that_is_too_large_for_its_neighbours_is_refused_in_plain_words(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(neighbours, "MOST_POINTS", 100)
    with pytest.raises(SurfaceError, match="101 points are too many") as caught:
        Places.of(np.zeros((101, 3)))
    assert "thin" in caught.value.hint


def test_what_was_seen_from_the_side_goes_and_without_directions_the_uncertain_goes() -> None:
    cloud = seen_all_around(ball(5_000))
    kept = parse_step({"kind": "grazing", "most_deg": 60.0}).apply(cloud)
    assert 0.4 < len(kept) / len(cloud) < 0.95
    # The camera stands 90 mm above the ball: its underside is what was seen worst.
    assert kept.points[:, 2].min() > cloud.points[:, 2].min() + 2.0
    unknown = replace(cloud, normals=np.zeros_like(cloud.normals))
    unknown.sigma_mm[:100] *= 10.0
    step = parse_step({"kind": "grazing", "most_deg": 60.0})
    assert len(step.apply(unknown)) == 4_900
    assert "uncertainty" in step.says(unknown)


def test_box_cylinder_and_lasso_part_the_cloud_in_two() -> None:
    cloud = ball(5_000)
    matrix = [[1, 0, 0, 0], [0, 0, 1, -30], [0, 0, 0, 0], [0, 0, 0, 1]]
    for step in (
        {"kind": "box", "low": [-50, -50, 0], "high": [0, 50, 100]},
        {"kind": "cylinder", "radius_mm": 15.0, "centre_mm": [3.0, 0.0]},
        {"kind": "lasso", "view": matrix, "polygon": [[-9, -9], [9, -9], [0, 12]]},
    ):
        inside = parse_step({**step, "keep": "inside"}).apply(cloud)
        outside = parse_step({**step, "keep": "outside"}).apply(cloud)
        assert len(inside) + len(outside) == len(cloud)
        assert 100 < len(inside) < len(cloud) - 100
    # The lasso was the last: seen from the front, its triangle is x against height.
    assert np.abs(inside.points[:, 0]).max() < 9.0
    assert inside.points[:, 2].min() > 21.0


def test_the_table_goes_and_the_foot_of_a_wall_stays() -> None:
    rng = np.random.default_rng(1)
    flat = np.column_stack([rng.uniform(-60, 60, (20_000, 2)), 0.05 * rng.normal(size=20_000)])
    # A table that lies 0.6 mm high and leans by half a degree.
    flat[:, 2] += 0.6 + np.tan(np.radians(0.5)) * flat[:, 0]
    turn = rng.uniform(0, 2 * np.pi, 20_000)
    round_ = np.column_stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)])
    wall = 15.0 * round_ + [0, 0, 1] * rng.uniform(0.6, 40.0, (20_000, 1))
    wall[:, 2] += np.tan(np.radians(0.5)) * wall[:, 0]
    up = np.tile([0.0, 0.0, 1.0], (len(flat), 1))
    flat_cloud, wall_cloud = cloud_of(flat, up), cloud_of(wall, round_)
    cloud = PointCloud.joined([flat_cloud, replace(wall_cloud, laser=np.ones(len(wall), np.uint8))])
    kept = parse_step({"kind": "table"}).apply(cloud)
    assert np.count_nonzero(kept.laser == 0) < 0.005 * len(flat)
    assert np.count_nonzero(kept.laser == 1) > 0.99 * len(wall)


def test_thinning_makes_means_that_are_surer_than_their_points() -> None:
    cloud = ball(40_000, 0.05)
    cloud.sigma_mm[::2] = 0.5
    cloud.points[::2] += np.random.default_rng(0).normal(0.0, 0.5, (20_000, 3)).astype(np.float32)
    thinned = parse_step({"kind": "thin", "size_mm": 1.5}).apply(cloud)
    assert len(thinned) < 0.3 * len(cloud)
    sure = np.flatnonzero(thinned.sigma_mm < 0.03)
    away = np.linalg.norm(thinned.points[sure] - [0, 0, 30], axis=1) - 20.0
    assert len(sure) > 500
    assert np.abs(np.median(away)) < 0.03
    assert float(np.sqrt(np.mean(away**2))) < 0.06
    assert np.allclose(np.linalg.norm(thinned.normals[sure], axis=1), 1.0, atol=1e-3)
    copies = parse_step({"kind": "thin"}).apply(cloud.select(np.zeros(5_000, np.intp)))
    assert len(copies) == 1


def test_smoothing_halves_the_noise_keeps_a_step_and_does_not_shrink_a_ball() -> None:
    cloud, is_upper = stairs(40_000, 0.05, 0.5)
    left = parse_step({"kind": "smooth"}).apply(cloud)
    for side, level in ((is_upper, 0.5), (~is_upper, 0.0)):
        near_edge = side & (np.abs(cloud.points[:, 0]) < 0.5)
        assert abs(float(left.points[near_edge, 2].mean()) - level) < 0.02
        assert float(left.points[side, 2].std()) < 0.025
    round_ = parse_step({"kind": "smooth"}).apply(ball(20_000, 0.03))
    radii = np.linalg.norm(round_.points - [0, 0, 30], axis=1)
    assert abs(float(radii.mean()) - 20.0) < 0.005
    assert float(radii.std()) < 0.02


def test_normals_of_a_foreign_cloud_look_outwards() -> None:
    cloud = ball(20_000, 0.01)
    ring = cloud.select((np.abs(cloud.points[:, 2] - 30.0) < 12.0) & (cloud.points[:, 0] > -12.0))
    # A stray point far away changes nothing for the others.
    stray = PointCloud.joined(
        [cloud, replace(cloud.select(np.arange(1)), points=np.full((1, 3), 1e9, np.float32))]
    )
    for each in (cloud, ring, stray):
        found = with_normals(replace(each, normals=np.zeros_like(each.normals)))
        facing = np.einsum("ij,ij->i", found.normals, each.normals)
        assert np.mean(facing > 0.95) > 0.99


def test_a_shift_between_lasers_is_found_and_mended_and_a_bent_patch_is_settled() -> None:
    left, right = seen_all_around(ball(8_000, 0.02)), seen_all_around(ball(8_000, 0.02))
    right = replace(right, laser=np.ones(8_000, np.uint8))
    # The right laser's plane is wrong by a constant in the room: on the table it turns with the angle.
    angle = -np.radians(right.angle_deg)
    error = 0.2 * np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    rng = np.random.default_rng(5)
    noise = rng.normal(0.0, 0.02, (8_000, 1)) * right.normals
    cloud = PointCloud.joined(
        [left, replace(right, points=(right.points + noise + error).astype(np.float32))]
    )
    (finding,) = map_lasers(cloud).findings
    assert (finding.first, finding.second) == ("left", "right")
    assert finding.share > 0.9
    assert finding.is_explained
    np.testing.assert_allclose(finding.shift_mm, [0.2, 0.0, 0.0], atol=0.02)
    step = parse_step({"kind": "lasers-agree"})
    assert "left and right lie" in step.says(cloud)
    mended = step.apply(cloud)
    (after,) = map_lasers(mended).findings
    assert after.median_mm < 0.3 * finding.median_mm
    bent = mended.points.copy()
    is_bent = (mended.laser == 1) & (mended.points[:, 2] > 45.0)
    bent[is_bent] *= np.float32(1.02)
    doubtful = replace(mended, points=bent, quality=np.where(is_bent, 0.2, 1.0).astype(np.float32))
    settled = step.apply(doubtful)
    assert np.count_nonzero(settled.quality < 0.5) < 0.1 * np.count_nonzero(is_bent)
    assert np.count_nonzero(settled.quality > 0.5) > 0.99 * np.count_nonzero(~is_bent)


def test_a_preview_tells_what_each_step_would_take_from_the_whole() -> None:
    cloud = ball(30_000)
    steps = [
        parse_step({"kind": "box", "low": [-50, -50, 30], "high": [50, 50, 100]}),
        parse_step({"kind": "radius-outliers", "radius_mm": 0.8}),
    ]
    shown = preview_steps(cloud, steps, most=10_000)
    assert shown.share == pytest.approx(1 / 3, rel=0.01)
    assert len(shown.cloud) == shown.effects[-1].after
    box, radius = shown.effects
    assert (box.kind, radius.kind) == ("box", "radius-outliers")
    assert box.taken == pytest.approx(15_000, rel=0.05)
    assert radius.taken < 1_500
