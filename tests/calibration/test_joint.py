"""The joint adjustment on views of known truth: how near it comes, and what it says about itself."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from app.calibration.joint import JointResult, solve_joint
from app.calibration.views import Evidence
from app.errors import CalibrationError
from app.geometry.camera import CameraIntrinsics
from app.recording.shot import Role
from app.vision.board import BoardSpec
from benchmarks.synthetic_views import (
    PLATTER,
    SHEET,
    Noise,
    SyntheticViews,
    surface_error_mm,
    typical_rig,
)

LARGE_BOARD = BoardSpec("chessboard", 11, 8, 10.0)
ANGLES_DEG = (-40.0, -20.0, 0.0, 20.0, 40.0)
SEEDS = range(4)
UNDISTORTED = (0.0, 0.0, 0.0, 0.0, 0.0)


def two_placements(seed: int, lasers: int = 1, noise: Noise | None = None) -> SyntheticViews:
    """Ten views of a board that stands once before and once behind the axis."""
    rng = np.random.default_rng(seed)
    views = SyntheticViews(typical_rig(lasers), rng, noise or Noise(), board=LARGE_BOARD)
    views.placement(0, ANGLES_DEG, 40.0, 20.0)
    views.placement(1, ANGLES_DEG, -40.0, -20.0)
    return views


def solved(views: SyntheticViews, camera: CameraIntrinsics | None = None) -> JointResult:
    return solve_joint(views.evidence(), camera or views.rig.camera, refine_camera=False)


@cache
def ten_views(seed: int, lasers: int = 1) -> tuple[SyntheticViews, JointResult]:
    views = two_placements(seed, lasers)
    return views, solved(views)


def test_ten_views_in_two_placements_leave_five_micrometres_at_the_surface() -> None:
    errors = []
    for seed in SEEDS:
        views, found = ten_views(seed)
        assert len(views.views) == 10
        errors.append(surface_error_mm(views.rig, found.rig))
    assert np.sqrt(np.mean(np.square(errors))) <= 0.005


def test_the_predicted_error_is_of_the_size_of_the_actual_one() -> None:
    pairs = [(surface_error_mm(v.rig, f.rig), f.expected_error_mm) for v, f in map(ten_views, range(8))]
    actual, predicted = np.sqrt(np.mean(np.square(pairs), axis=0))
    assert 0.5 < actual / predicted < 2.0


def test_chi_is_one_and_the_noise_is_found_where_the_model_is_right() -> None:
    for seed in SEEDS:
        _, found = ten_views(seed)
        assert found.chi == pytest.approx(1.0, abs=0.1)
        assert found.noise_px["board corners"] == pytest.approx(0.10, rel=0.1)


def test_distortion_left_out_raises_chi() -> None:
    views, right = ten_views(0)
    flat = replace(views.rig.camera, distortion=np.zeros(5))
    assert solved(views, flat).chi > 1.5 * right.chi


def test_two_lasers_are_both_found_and_share_the_axis() -> None:
    views, found = ten_views(1, 2)
    assert set(found.rig.lasers) == {"left", "right"}
    for name, plane in views.rig.lasers.items():
        off = found.rig.lasers[name].signed_distance(views.rig.axis.origin[None])
        assert float(off[0] - plane.signed_distance(views.rig.axis.origin[None])[0]) == pytest.approx(
            0.0, abs=0.01
        )
    assert surface_error_mm(views.rig, found.rig) < 0.005


def test_angles_are_recovered_although_the_commanded_ones_are_wrong() -> None:
    views = two_placements(2)
    wrong = [
        replace(view, angle_rad=view.angle_rad + np.radians(3.0 * np.sin(7.0 * k)))
        for k, view in enumerate(views.views)
    ]
    right = solved(views)
    found = solve_joint(replace(views.evidence(), views=tuple(wrong)), views.rig.camera, refine_camera=False)
    for part in (slice(0, 5), slice(5, 10)):
        turned = np.array([view.angle_deg for view in found.views[part]])
        expected = np.array([view.angle_deg for view in right.views[part]])
        np.testing.assert_allclose(turned - turned[0], expected - expected[0], atol=1e-3)
    assert surface_error_mm(views.rig, found.rig) == pytest.approx(
        surface_error_mm(views.rig, right.rig), abs=1e-5
    )


def test_a_view_with_a_jittered_angle_says_how_far_it_was_off() -> None:
    views = two_placements(3)
    views.jitter_deg = 0.0
    views.placement(2, (-30.0, 0.0, 30.0), 30.0, 0.0)
    off = replace(views.views[-1], angle_rad=views.views[-1].angle_rad + np.radians(2.0))
    found = solve_joint(
        replace(views.evidence(), views=(*views.views[:-1], off)), views.rig.camera, refine_camera=False
    )
    errors = [view.angle_error_deg for view in found.views[-3:]]
    assert errors[2] - errors[1] == pytest.approx(-2.0, abs=0.02)
    assert errors[1] - errors[0] == pytest.approx(0.0, abs=0.02)


def test_unknown_angles_do_no_harm() -> None:
    views = two_placements(4)
    unknown = tuple(replace(view, angle_rad=float("nan")) for view in views.views)
    found = solve_joint(replace(views.evidence(), views=unknown), views.rig.camera, refine_camera=False)
    right = solved(views)
    assert surface_error_mm(right.rig, found.rig) < 1e-5
    np.testing.assert_allclose(found.rig.axis.direction, right.rig.axis.direction, atol=1e-6)


def test_angles_that_run_the_other_way_are_noticed() -> None:
    views = two_placements(5)
    backwards = tuple(replace(view, angle_rad=-view.angle_rad) for view in views.views)
    found = solve_joint(replace(views.evidence(), views=backwards), views.rig.camera, refine_camera=False)
    assert any("turntable.direction" in text for text in found.warnings)


def test_a_free_camera_is_found_with_the_rest() -> None:
    views = two_placements(6)
    views.free_boards(12)
    truth = views.rig.camera
    start = CameraIntrinsics(
        truth.matrix + np.array([[4.0, 0.0, 3.0], [0.0, 4.0, -3.0], [0.0, 0.0, 0.0]]),
        truth.distortion * 0.8,
        truth.size,
    )
    found = solve_joint(views.evidence(), start, refine_camera=True)
    assert found.rig.camera.distortion[4] == 0.0
    assert found.camera_sigma[8] == 0.0
    off = np.abs(found.rig.camera.matrix - truth.matrix)[:2].ravel()
    sigma = found.camera_sigma[[0, 2, 2, 3, 1, 3]]
    assert (off[[0, 2, 4, 5]] < 4.0 * sigma[[0, 1, 4, 5]]).all()
    assert found.chi == pytest.approx(1.0, abs=0.1)
    assert surface_error_mm(views.rig, found.rig) < 0.05
    assert surface_error_mm(views.rig, found.rig) < 4.0 * found.expected_error_mm


def test_a_camera_that_is_given_stays_as_it_is() -> None:
    views, found = ten_views(0)
    np.testing.assert_array_equal(found.rig.camera.matrix, views.rig.camera.matrix)
    assert not found.camera_sigma.any()


def test_gross_errors_among_the_corners_do_little() -> None:
    views = two_placements(7)
    rng = np.random.default_rng(0)
    for k, view in enumerate(views.views):
        corners = view.board.corners.copy()
        corners[rng.integers(0, len(corners))] += 4.0
        views.views[k] = replace(view, board=replace(view.board, corners=corners))
    assert surface_error_mm(views.rig, solved(views).rig) < 0.01


def with_markers(seed: int, printed_mm: float, lost_deg: float = 0.0) -> SyntheticViews:
    """Boards as before, and the bare table over a whole turn on a motor that loses a step half way."""
    views = two_placements(seed)
    commanded = np.arange(0.0, 360.0, 20.0)
    true = commanded - np.where(commanded > 90.0, lost_deg, 0.0)
    views.markers(commanded.tolist(), true.tolist(), printed_mm)
    return views


@cache
def marked() -> tuple[SyntheticViews, JointResult]:
    views = with_markers(8, 19.6, 1.8)
    return views, solved(views)


def test_markers_show_at_which_scale_they_were_printed() -> None:
    _, found = marked()
    assert found.marker_mm == pytest.approx(19.6, abs=0.01)
    assert any("19.60 mm, not the 20 mm" in text for text in found.warnings)


def test_markers_lie_where_they_were_found() -> None:
    _, found = marked()
    assert set(found.layout) == set(PLATTER.ids)
    for number, place in zip(PLATTER.ids, SHEET, strict=True):
        corners = found.layout[number]
        assert np.abs(corners[:, 2]).max() < 0.02
        assert np.linalg.norm(corners[1] - corners[0]) == pytest.approx(19.6, abs=0.02)
        assert np.hypot(*corners.mean(axis=0)[:2]) == pytest.approx(np.hypot(*place[:2]), abs=0.02)
    first, second = (found.layout[number].mean(axis=0)[:2] for number in PLATTER.ids[:2])
    turn = np.arctan2(first[0] * second[1] - first[1] * second[0], first @ second)
    a, b = SHEET[0, :2], SHEET[1, :2]
    assert turn == pytest.approx(np.arctan2(a[0] * b[1] - a[1] * b[0], a @ b), abs=1e-3)


def test_markers_give_the_table_its_height() -> None:
    views, found = marked()
    np.testing.assert_allclose(found.rig.axis.origin, views.rig.axis.origin, atol=0.02)


def test_markers_tell_where_the_motor_lost_a_step() -> None:
    _, found = marked()
    errors = np.array([v.angle_error_deg for v in found.views if v.role is Role.SCAN])
    commanded = np.array([v.commanded_deg for v in found.views if v.role is Role.SCAN])
    before, after = errors[commanded <= 90.0], errors[commanded > 90.0]
    assert before.mean() - after.mean() == pytest.approx(1.8, abs=0.02)
    assert max(before.std(), after.std()) < 0.03


def test_without_a_stripe_across_them_the_stated_side_of_the_markers_holds() -> None:
    views = with_markers(9, 20.0)
    dark = tuple(replace(view, stripes={}) if view.role is Role.SCAN else view for view in views.views)
    found = solve_joint(replace(views.evidence(), views=dark), views.rig.camera, refine_camera=False)
    assert found.marker_mm == 20.0
    np.testing.assert_allclose(found.rig.axis.origin, views.rig.axis.origin, atol=0.05)


def test_an_object_on_the_table_does_not_bend_the_planes() -> None:
    views = with_markers(12, 19.6)
    rng = np.random.default_rng(0)
    crowded = []
    for view in views.views:
        if view.role is Role.SCAN and "left" in view.stripes:
            stripe = view.stripes["left"]
            pixels = stripe.pixels.copy()
            is_object = np.arange(len(stripe)) > 0.4 * len(stripe)
            pixels[is_object, 0] += rng.uniform(-60.0, 60.0, int(is_object.sum()))
            view = replace(view, stripes={"left": replace(stripe, pixels=pixels)})
        crowded.append(view)
    found = solve_joint(
        replace(views.evidence(), views=tuple(crowded)), views.rig.camera, refine_camera=False
    )
    assert surface_error_mm(views.rig, found.rig) < 0.02
    assert found.chi < 2.0


def test_markers_alone_give_axis_and_table() -> None:
    views = SyntheticViews(typical_rig(), np.random.default_rng(10))
    commanded = np.arange(0.0, 360.0, 20.0)
    views.markers(commanded.tolist(), commanded.tolist(), 20.0)
    found = solved(views)
    assert found.rig.lasers == {}
    np.testing.assert_allclose(found.rig.axis.origin, views.rig.axis.origin, atol=0.1)
    assert found.rig.axis.direction @ views.rig.axis.direction > 1.0 - 1e-6


def usable(evidence: Evidence, camera: CameraIntrinsics) -> JointResult:
    """A result without a NaN in the rig, whatever else may be said of it."""
    found = solve_joint(evidence, camera, refine_camera=False)
    assert np.isfinite(found.rig.axis.point_mm).all()
    assert np.isfinite(found.rig.axis.direction).all()
    for plane in found.rig.lasers.values():
        assert np.isfinite(plane.normal).all()
        assert np.isfinite(plane.distance_mm)
    assert np.isfinite(found.chi)
    return found


def test_a_board_through_the_axis_says_how_little_it_knows() -> None:
    # Of an even number of columns the middle is no edge, so the stripe along the axis can be used.
    even_board = BoardSpec("chessboard", 10, 7, 10.0)
    views = SyntheticViews(typical_rig(), np.random.default_rng(0), board=even_board)
    views.placement(0, ANGLES_DEG, 0.0, 0.0)
    found = usable(views.evidence(), views.rig.camera)
    _, good = ten_views(0)
    assert found.expected_error_mm > 5.0 * good.expected_error_mm


def test_a_table_that_never_turned_gives_planes_but_no_axis() -> None:
    views = SyntheticViews(typical_rig(), np.random.default_rng(0), board=LARGE_BOARD)
    views.placement(0, (0.0, 0.0, 0.0), 40.0, 20.0)
    views.free_boards(6, role=Role.LASER_PLANE)
    found = usable(views.evidence(), views.rig.camera)
    assert not found.has_axis
    assert set(found.rig.lasers) == {"left"}
    assert np.isnan(found.expected_error_mm)


def test_one_view_of_the_board_is_refused_in_a_sentence() -> None:
    views = SyntheticViews(typical_rig(), np.random.default_rng(0), board=LARGE_BOARD)
    views.placement(0, (0.0,), 40.0, 0.0)
    with pytest.raises(CalibrationError, match="neither a laser on it nor a table that turns"):
        solved(views)


def test_no_view_at_all_is_refused_in_a_sentence() -> None:
    views = SyntheticViews(typical_rig(), np.random.default_rng(0))
    with pytest.raises(CalibrationError, match="board was not seen"):
        solved(views)


def test_two_views_of_a_turn_are_enough_for_an_answer() -> None:
    views = SyntheticViews(typical_rig(), np.random.default_rng(0), board=LARGE_BOARD)
    views.placement(0, (-20.0, 20.0), 40.0, 0.0)
    found = usable(views.evidence(), views.rig.camera)
    assert found.has_axis


def test_a_board_that_was_moved_between_the_views_shows_in_chi() -> None:
    views = two_placements(11)
    moved = SyntheticViews(views.rig, np.random.default_rng(1), board=LARGE_BOARD)
    moved.placement(0, ANGLES_DEG, 46.0, 26.0)
    mixed = (*views.views[:3], *moved.views[3:5], *views.views[5:])
    found = usable(replace(views.evidence(), views=mixed), views.rig.camera)
    assert found.chi > 3.0 or found.axis_rms_mm > 1.0
