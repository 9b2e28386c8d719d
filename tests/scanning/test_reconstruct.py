import dataclasses
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from small_scans import SmallScan, make_small_scan

from app.errors import ReconstructionError
from app.geometry.cloud import PointCloud
from app.geometry.plane import LaserPlane
from app.recording.shot import Role, Shot
from app.recording.simulated import simulate_recording
from app.recording.simulated_plan import SimulationPlan
from app.scanning.profile import Profile
from app.scanning.reconstruct import ReconstructionOptions
from app.scanning.sources import reconstruct_recording, reconstruct_shots, scan_detector
from app.simulation.rig import standard_rig


@pytest.fixture(scope="session")
def small_scan(tmp_path_factory: pytest.TempPathFactory) -> SmallScan:
    return make_small_scan(tmp_path_factory.getbasetemp())


def joined(run: object) -> PointCloud:
    return PointCloud.joined([profile.cloud for profile in run])  # type: ignore[attr-defined]


def last_stops(scan: SmallScan, profiles: list[Profile]) -> np.ndarray:
    return scan.off(PointCloud.joined([profile.cloud for profile in profiles if profile.number >= 36]))


def shots_of(scan: SmallScan, stops: int = 6) -> list[Shot]:
    return list(scan.recording.load_each(scan.recording.select(Role.SCAN, Role.TEXTURE)[: 3 * stops]))


def rebuilt(scan: SmallScan, shots: list[Shot]) -> PointCloud:
    rig, colours = scan.plan.scanner.rig, scan.recording.lasers
    return joined(reconstruct_shots(shots, rig, scan_detector(), colours, scan.recording.turn_rad))


def test_the_ball_comes_out_round(small_scan: SmallScan) -> None:
    cloud = PointCloud.joined([profile.cloud for profile in small_scan.profiles])
    off = small_scan.off(cloud)
    assert len(off) > 5000
    assert np.sqrt(np.mean(off**2)) < 0.08
    assert np.abs(off).max() < 1.0


def test_both_lasers_see_the_ball_in_the_same_place(small_scan: SmallScan) -> None:
    (pair,) = small_scan.reports[0].agreements
    assert {pair.first, pair.second} == {"left", "right"}
    assert pair.disagreement_mm < 0.08
    assert pair.pairs > 500


def test_normals_point_out_of_the_ball(small_scan: SmallScan) -> None:
    cloud = PointCloud.joined([profile.cloud for profile in small_scan.profiles])
    is_ball = (cloud.points[:, 2] > 2.0) & np.any(cloud.normals != 0.0, axis=1)
    outward = cloud.points[is_ball] - small_scan.centre
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    cosine = np.sum(outward * cloud.normals[is_ball], axis=1)
    assert is_ball.sum() > 0.95 * np.count_nonzero(cloud.points[:, 2] > 2.0)
    assert np.median(cosine) > np.cos(np.radians(2.0))
    assert (cosine > 0.5).mean() > 0.99


def test_the_lost_step_is_told_by_the_markers(small_scan: SmallScan) -> None:
    report = small_scan.reports[0]
    assert report.angles.source == "markers"
    assert report.angles.stops_with_markers == 40
    assert report.angles.largest_deg == pytest.approx(small_scan.lost_deg, abs=0.15)
    assert "behind the commanded angle" in report.angles.sentence
    assert "the motor lost steps" in report.angles.sentence
    assert report.angles.sentence in report.warnings


def test_without_markers_the_lost_step_spoils_the_ball(small_scan: SmallScan) -> None:
    rig = small_scan.plan.scanner.rig
    told = ReconstructionOptions(uses_markers=False)
    run = reconstruct_recording(small_scan.recording, rig, scan_detector(), told)
    believed = last_stops(small_scan, list(run))
    known = last_stops(small_scan, small_scan.profiles)
    assert run.report().angles.source == "commanded angle"
    assert np.std(believed) > 1.5 * np.std(known)


def test_the_table_is_found_where_it_is(small_scan: SmallScan) -> None:
    tables = {table.source: table for table in small_scan.reports[0].tables}
    assert abs(tables["points"].offset_mm) < 0.1
    assert abs(tables["markers"].offset_mm) < 0.1
    assert tables["points"].tilt_deg < 0.1
    assert not tables["points"].is_moved


def test_a_laser_that_was_moved_is_noticed(small_scan: SmallScan) -> None:
    rig = small_scan.plan.scanner.rig
    plane = rig.lasers["left"]
    lasers = {**rig.lasers, "left": LaserPlane(plane.normal, plane.distance_mm + 2.0)}
    run = reconstruct_recording(
        small_scan.recording, dataclasses.replace(rig, lasers=lasers), scan_detector()
    )
    joined(run)
    report = run.report()
    assert report.agreements[0].disagreement_mm > 0.5
    assert any("'left' and 'right' disagree" in warning for warning in report.doubts)


def test_a_camera_that_was_moved_is_noticed_by_the_markers(small_scan: SmallScan) -> None:
    rig = small_scan.plan.scanner.rig
    axis = dataclasses.replace(rig.axis, point_mm=rig.axis.point_mm + np.array([0.0, 3.0, 0.0]))
    run = reconstruct_recording(small_scan.recording, dataclasses.replace(rig, axis=axis), scan_detector())
    joined(run)
    assert any("calibrate again" in warning for warning in run.report().doubts)


def test_the_region_bounds_the_cloud(small_scan: SmallScan) -> None:
    rig = small_scan.plan.scanner.rig
    options = ReconstructionOptions(radius_mm=25.0, above_mm=5.0, below_mm=40.0)
    run = reconstruct_recording(small_scan.recording, rig, scan_detector(), options)
    cloud = joined(run)
    assert np.hypot(cloud.points[:, 0], cloud.points[:, 1]).max() <= 25.0
    assert cloud.points[:, 2].min() >= 5.0
    assert cloud.points[:, 2].max() <= 40.0
    assert run.report().outside > 0


def test_points_above_a_height_alone_leave_the_table_out(small_scan: SmallScan) -> None:
    rig = small_scan.plan.scanner.rig
    options = ReconstructionOptions(above_mm=1.0, uses_markers=False)
    cloud = joined(reconstruct_recording(small_scan.recording, rig, scan_detector(), options))
    assert cloud.points[:, 2].min() >= 1.0


def test_a_stream_of_shots_gives_what_the_disk_gives(small_scan: SmallScan) -> None:
    rig, colours = small_scan.plan.scanner.rig, small_scan.recording.lasers
    shots = small_scan.recording.shots(Role.SCAN, Role.TEXTURE)
    live = joined(reconstruct_shots(shots, rig, scan_detector(), colours, small_scan.recording.turn_rad))
    options = ReconstructionOptions(uses_markers=False)
    stored = joined(reconstruct_recording(small_scan.recording, rig, scan_detector(), options))
    np.testing.assert_array_equal(live.points, stored.points)
    np.testing.assert_array_equal(live.colours, stored.colours)
    np.testing.assert_array_equal(live.normals, stored.normals)


def test_prompt_profiles_wait_for_no_neighbour(small_scan: SmallScan) -> None:
    rig, colours = small_scan.plan.scanner.rig, small_scan.recording.lasers
    lit = [shot for shot in shots_of(small_scan, 5) if shot.lasers_on == ("left",)]
    taken = 0

    def camera() -> Iterator[Shot]:
        nonlocal taken
        for shot in lit:
            taken += 1
            yield shot

    def profiles(*, is_prompt: bool) -> Iterator[Profile]:
        options = ReconstructionOptions(workers=1, ahead=0, is_prompt=is_prompt)
        return iter(
            reconstruct_shots(
                camera(), rig, scan_detector(), {"left": colours["left"]}, small_scan.recording.turn_rad,
                options, each_alone=True,
            )
        )  # fmt: skip

    at_leisure = list(profiles(is_prompt=False))
    taken = 0
    prompt = []
    for profile in profiles(is_prompt=True):
        prompt.append(profile)
        assert taken <= len(prompt) + 1
    assert len(prompt) == len(at_leisure) == len(lit)
    for one, other in zip(prompt, at_leisure, strict=True):
        np.testing.assert_array_equal(one.cloud.points, other.cloud.points)
    assert np.any(prompt[1].cloud.normals != 0.0)


def test_a_live_scan_gives_profiles_while_it_runs(small_scan: SmallScan) -> None:
    taken = 0

    def camera() -> Iterator[Shot]:
        nonlocal taken
        for shot in shots_of(small_scan, 8):
            taken += 1
            yield shot

    rig, colours = small_scan.plan.scanner.rig, small_scan.recording.lasers
    options = ReconstructionOptions(workers=1, ahead=0)
    run = reconstruct_shots(camera(), rig, scan_detector(), colours, small_scan.recording.turn_rad, options)
    next(iter(run))
    assert taken <= 3 * 4 + 1


def test_both_lasers_in_one_picture_are_told_apart(small_scan: SmallScan) -> None:
    both = []
    for dark, left, right in np.array(shots_of(small_scan), object).reshape(-1, 3):
        sum_of_light = left.image.astype(int) + right.image - dark.image
        image = np.clip(sum_of_light, 0, 255).astype(np.uint8)
        both += [dark, dataclasses.replace(left, image=image, lasers_on=("left", "right"))]
    together, apart = rebuilt(small_scan, both), rebuilt(small_scan, shots_of(small_scan))
    off = small_scan.off(together)
    assert np.abs(off).max() < 1.0
    for laser in (0, 1):
        assert (together.laser == laser).sum() > 0.6 * (apart.laser == laser).sum()


def test_a_stack_of_exposures_repairs_a_clipped_stripe(small_scan: SmallScan) -> None:
    stacks = []
    for dark, left, right in np.array(shots_of(small_scan), object).reshape(-1, 3):
        for gain, exposure in ((6.0, 60_000.0), (1.0, 10_000.0)):
            for shot in (dark, left, right):
                image = np.clip(shot.image * gain, 0, 255).astype(np.uint8)
                stacks.append(dataclasses.replace(shot, image=image, exposure_us=exposure))
    stacked = rebuilt(small_scan, stacks)
    longest = rebuilt(small_scan, [shot for shot in stacks if shot.exposure_us == 60_000.0])
    single = rebuilt(small_scan, shots_of(small_scan))
    assert len(stacked) >= len(single)
    assert np.sqrt(np.mean(small_scan.off(stacked) ** 2)) < np.sqrt(np.mean(small_scan.off(longest) ** 2))


def test_colours_come_from_the_nearest_picture_where_a_stop_has_none(small_scan: SmallScan) -> None:
    with_all = rebuilt(small_scan, shots_of(small_scan, 3))
    shots = shots_of(small_scan, 3)
    sparse = rebuilt(small_scan, [shot for k, shot in enumerate(shots) if k == 0 or shot.lasers_on])
    ball = sparse.points[:, 2] > 5.0
    assert (
        abs(
            float(np.median(sparse.colours[ball]))
            - float(np.median(with_all.colours[with_all.points[:, 2] > 5.0]))
        )
        < 12.0
    )


def test_without_any_colour_picture_points_are_grey(small_scan: SmallScan) -> None:
    cloud = rebuilt(small_scan, [shot for shot in shots_of(small_scan, 3) if shot.lasers_on])
    assert (cloud.colours[:, 0] == cloud.colours[:, 2]).all()
    assert cloud.colours.max() > 60


def test_the_uncertainty_is_of_the_size_of_the_error(small_scan: SmallScan) -> None:
    cloud = PointCloud.joined([profile.cloud for profile in small_scan.profiles])
    ball = cloud.select((cloud.points[:, 2] > 2.0) & (cloud.quality > 0.5))
    chi = small_scan.off(ball) / ball.sigma_mm
    assert 0.2 < 1.4826 * np.median(np.abs(chi)) < 4.0
    assert ((cloud.quality >= 0.0) & (cloud.quality <= 1.0)).all()


def test_background_stripes_are_left_out(tmp_path: Path) -> None:
    plan = SimulationPlan(
        scanner=standard_rig(480, 270, stripe_sigma_px=1.2), parts=("scan",), steps=3, background_steps=1
    )
    recording = simulate_recording(tmp_path / "scan", plan)
    rig = plan.scanner.rig
    kept = joined(reconstruct_recording(recording, rig, scan_detector()))
    entries = recording.select(Role.SCAN, Role.TEXTURE)
    everything = joined(
        reconstruct_shots(
            recording.load_each(entries), rig, scan_detector(), recording.lasers, recording.turn_rad
        )
    )
    on_table, on_ball = everything.points[:, 2] < 0.5, everything.points[:, 2] > 5.0
    assert (kept.points[:, 2] < 0.5).sum() < 0.1 * on_table.sum()
    assert (kept.points[:, 2] > 5.0).sum() > 0.98 * on_ball.sum()


def test_a_table_that_turns_steadily_and_clockwise_gives_the_ball_too(tmp_path: Path) -> None:
    plan = SimulationPlan(
        scanner=standard_rig(480, 270, stripe_sigma_px=1.2),
        parts=("scan",),
        steps=12,
        seconds_per_turn=24.0,
        lasers=("left",),
        direction="cw",
    )
    recording = simulate_recording(tmp_path / "scan", plan)
    run = reconstruct_recording(recording, plan.scanner.rig, scan_detector())
    cloud = joined(run)
    centre = plan.table_from_item.translation + np.array([0.0, 0.0, 30.0])
    ball = cloud.points[cloud.points[:, 2] > 2.0]
    off = np.linalg.norm(ball - centre, axis=1) - 30.0
    assert np.sqrt(np.mean(off**2)) < 0.15
    assert run.report().angles.source == "constant speed"
    assert run.total == 12


def test_only_the_part_of_the_picture_that_was_drawn_gives_points(small_scan: SmallScan) -> None:
    rig = small_scan.plan.scanner.rig
    upper = ((0.0, 0.0), (1.0, 0.0), (1.0, 0.5), (0.0, 0.5))
    options = ReconstructionOptions(uses_markers=False, polygon=upper)
    run = reconstruct_recording(small_scan.recording, rig, scan_detector(), options)
    rows = [
        rig.camera.project(
            rig.axis.table_from_camera(each.angle_rad).inverse() @ each.cloud.points.astype(np.float64)
        )
        for each in run
        if len(each.cloud)
    ]
    assert 0 < sum(map(len, rows)) < len(joined(small_scan.profiles))
    assert max(row[:, 1].max() for row in rows) < rig.camera.size[1] / 2 + 1.0


def test_a_higher_threshold_and_another_channel_find_less_of_the_stripe(small_scan: SmallScan) -> None:
    rig = small_scan.plan.scanner.rig
    whole = len(joined(small_scan.profiles))
    dim = ReconstructionOptions(uses_markers=False, threshold=120.0)
    strong = joined(reconstruct_recording(small_scan.recording, rig, scan_detector(threshold=120.0), dim))
    assert 0 < len(strong) < whole
    blue = ReconstructionOptions(uses_markers=False, channel="blue")
    with pytest.raises(ReconstructionError, match="never seen"):
        list(reconstruct_recording(small_scan.recording, rig, scan_detector(), blue))
