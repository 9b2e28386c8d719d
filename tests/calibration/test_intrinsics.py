"""A camera is found again from what it saw, wrong views are found out, and doubts are spoken."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from app.calibration.intrinsics import DistortionModel, IntrinsicsResult, solve_intrinsics
from app.errors import CalibrationError
from app.geometry.camera import CameraIntrinsics
from app.geometry.transform import RigidTransform
from app.vision.board import BoardObservation, BoardSpec

SPEC = BoardSpec("chessboard", 9, 6, 25.0)
SIZE = (1280, 720)
CAMERA = CameraIntrinsics(
    np.array([[1100.0, 0.0, 652.0], [0.0, 1103.0, 348.0], [0.0, 0.0, 1.0]]),
    np.array([-0.12, 0.06, 0.0008, -0.0005, 0.0]),
    SIZE,
)
WIDE = CameraIntrinsics(
    np.array([[620.0, 0.0, 652.0], [0.0, 621.0, 348.0], [0.0, 0.0, 1.0]]),
    np.array([-0.33, 0.16, 0.0, 0.0, -0.045]),
    SIZE,
)


def view(
    camera: CameraIntrinsics,
    rvec: tuple[float, float, float],
    centre: tuple[float, float, float],
    rng: np.random.Generator,
    noise_px: float = 0.1,
    bend_mm: float = 0.0,
) -> BoardObservation:
    """What the camera sees of the board with its middle at `centre`, without corners outside the picture."""
    board = SPEC.points()
    middle = board.mean(axis=0)
    bent = board.copy()
    bent[:, 2] = bend_mm * ((board - middle)[:, 0] / 100.0) ** 2
    turned = RigidTransform.from_rvec(np.array(rvec), np.zeros(3))
    shift = RigidTransform(turned.rotation, np.array(centre) - turned.rotation @ middle)
    pixels = camera.project(shift @ bent) + rng.normal(0.0, noise_px, (len(board), 2))
    inside = np.all((pixels >= 0.0) & (pixels <= np.array(SIZE) - 1.0), axis=1)
    return BoardObservation(np.arange(len(board)), pixels, board).select(inside)


def good_views(
    camera: CameraIntrinsics = CAMERA, count: int = 16, noise_px: float = 0.1, seed: int = 1
) -> list[BoardObservation]:
    """Tilted every way, near and far, all over the picture."""
    rng = np.random.default_rng(seed)
    views = []
    for number in range(count):
        turn = 2.4 * number
        tilt = 0.35 + 0.3 * rng.random()
        depth = 380.0 + 300.0 * rng.random()
        wide = 0.5 * depth * 1100.0 / camera.matrix[0, 0]
        centre = (wide * 0.7 * np.cos(1.7 * turn), wide * 0.4 * np.sin(1.7 * turn), depth)
        rvec = (tilt * np.cos(turn), tilt * np.sin(turn), 0.2 * rng.normal())
        views.append(view(camera, rvec, centre, rng, noise_px))
    return views


def parallel_views(noise_px: float = 0.05) -> list[BoardObservation]:
    rng = np.random.default_rng(3)
    places = rng.uniform([-120.0, -60.0, 500.0], [120.0, 60.0, 700.0], (15, 3))
    return [view(CAMERA, (0.0, 0.0, 0.1 * x), (x, y, z), rng, noise_px) for x, y, z in places]


def test_the_camera_comes_back_within_its_standard_deviations() -> None:
    result = solve_intrinsics(good_views(), SIZE)
    truth = np.concatenate([CAMERA.matrix[[0, 1, 0, 1], [0, 1, 2, 2]], CAMERA.distortion])
    found = np.concatenate([result.camera.matrix[[0, 1, 0, 1], [0, 1, 2, 2]], result.camera.distortion])
    assert np.all(np.abs(found - truth)[:8] < 4.0 * result.standard_deviations[:8])
    assert result.standard_deviations[0] < 3.0
    assert result.rms_px == pytest.approx(0.1 * np.sqrt(2.0), rel=0.1)
    assert_allclose(result.rms_per_view_px, result.rms_px, rtol=0.4)
    assert result.warnings == ()
    assert result.dropped == ()


def test_residuals_are_measured_minus_predicted_in_every_view() -> None:
    result = solve_intrinsics(good_views(), SIZE)
    for fitted in result.views:
        seen = good_views()[fitted.index]
        predicted = result.camera.project(fitted.camera_from_board @ seen.board_points)
        assert_allclose(fitted.residuals, seen.corners - predicted, atol=1e-9)


@settings(max_examples=5, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_any_set_of_good_views_gives_the_focal_length_to_three_tenths_of_a_percent(seed: int) -> None:
    result = solve_intrinsics(good_views(seed=seed), SIZE)
    assert_allclose(result.camera.matrix[[0, 1], [0, 1]], [1100.0, 1103.0], rtol=3e-3)


@pytest.mark.parametrize("planted", ["bent", "shuffled", "shaken", "hallucinated"])
def test_a_wrong_view_is_found_and_dropped_with_a_reason(planted: str) -> None:
    rng = np.random.default_rng(5)
    views = good_views()
    for index in (4, 9):
        seen = views[index]
        if planted == "bent":
            wrong = view(CAMERA, (0.4, 0.3, 0.0), (10.0, 5.0, 450.0), rng, bend_mm=6.0)
        elif planted == "shuffled":
            wrong = BoardObservation(seen.ids, rng.permutation(seen.corners), seen.board_points)
        elif planted == "shaken":
            shaken = seen.corners + rng.normal(0.0, 1.5, seen.corners.shape)
            wrong = BoardObservation(seen.ids, shaken, seen.board_points)
        else:
            wrong = BoardObservation(seen.ids, rng.uniform(0.0, 700.0, seen.corners.shape), seen.board_points)
        views[index] = wrong
    result = solve_intrinsics(views, SIZE)
    assert [view.index for view in result.dropped] == [4, 9]
    assert all(view.reason for view in result.dropped)
    assert_allclose(result.camera.matrix[0, 0], 1100.0, rtol=3e-3)
    assert len(result.views) == 14


def test_a_view_stretched_as_a_whole_is_dropped_although_it_is_a_perfect_plane() -> None:
    views = good_views()
    seen = views[3]
    views[3] = BoardObservation(seen.ids, seen.corners * [1.0, 0.85] + [0.0, 50.0], seen.board_points)
    result = solve_intrinsics(views, SIZE)
    assert [view.index for view in result.dropped] == [3]


def test_views_without_a_board_are_counted_and_skipped() -> None:
    result = solve_intrinsics([BoardObservation.empty(), *good_views()], SIZE)
    assert [(view.index, view.reason) for view in result.dropped] == [(0, "no board was found in it")]
    assert result.views[0].index == 1


def test_partly_seen_boards_are_enough() -> None:
    rng = np.random.default_rng(2)
    views = [seen.select(rng.random(len(seen.ids)) < 0.5) for seen in good_views(count=20)]
    result = solve_intrinsics(views, SIZE)
    assert_allclose(result.camera.matrix[0, 0], 1100.0, rtol=3e-3)


@pytest.mark.parametrize("noise_px", [0.0, 0.05])
def test_parallel_boards_are_doubted_however_small_the_residuals(noise_px: float) -> None:
    result = solve_intrinsics(parallel_views(noise_px), SIZE)
    assert result.rms_px < 0.1
    assert any("parallel" in warning for warning in result.warnings)
    assert_is_finite(result)


def test_few_views_are_doubted() -> None:
    result = solve_intrinsics(good_views(count=4), SIZE)
    assert any("Only 4 views" in warning for warning in result.warnings)


def test_corners_in_one_part_of_the_picture_are_doubted() -> None:
    rng = np.random.default_rng(2)
    views = []
    for number in range(12):
        turn = 2.4 * number
        rvec = (0.5 * np.cos(turn), 0.5 * np.sin(turn), 0.1)
        views.append(view(CAMERA, rvec, (-300.0, -150.0, 900.0 + 40.0 * number), rng))
    result = solve_intrinsics(views, SIZE)
    assert result.coverage.share < 0.5
    assert result.coverage.counts.sum() == sum(len(seen.ids) for seen in views)
    assert any("of the picture" in warning for warning in result.warnings)


def test_one_distance_is_doubted() -> None:
    rng = np.random.default_rng(2)
    views = []
    for number in range(16):
        turn = 2.4 * number
        rvec = (0.5 * np.cos(turn), 0.5 * np.sin(turn), 0.0)
        views.append(view(CAMERA, rvec, (60.0 * np.cos(turn), 30.0 * np.sin(turn), 500.0), rng))
    assert any("same distance" in warning for warning in solve_intrinsics(views, SIZE).warnings)


@pytest.mark.parametrize(("camera", "model"), [(CAMERA, "paper"), (WIDE, "full")])
def test_k3_is_kept_only_where_the_views_determine_it(
    camera: CameraIntrinsics, model: DistortionModel
) -> None:
    result = solve_intrinsics(good_views(camera, 24, 0.05), SIZE, model="full")
    assert result.model == model
    assert (result.camera.distortion[4] == 0.0) == (model == "paper")
    assert (result.standard_deviations[8] == 0.0) == (model == "paper")


def test_the_paper_model_holds_k3_at_zero() -> None:
    result = solve_intrinsics(good_views(WIDE), SIZE, model="paper")
    assert result.model == "paper"
    assert result.camera.distortion[4] == 0.0


def test_a_board_that_was_never_seen_is_named() -> None:
    with pytest.raises(CalibrationError, match="No chessboard 9 x 6, 25 mm was found in any of the 3"):
        solve_intrinsics([BoardObservation.empty()] * 3, SIZE, sought=SPEC.description)


def test_two_views_are_too_few_for_a_camera() -> None:
    with pytest.raises(CalibrationError, match="Only 2 of 2 pictures"):
        solve_intrinsics(good_views(count=2), SIZE)


def test_no_view_at_all_is_an_error_too() -> None:
    with pytest.raises(CalibrationError):
        solve_intrinsics([], SIZE)


def test_the_same_view_again_and_again_never_gives_numbers_that_look_sound() -> None:
    views = [good_views()[2]] * 10
    try:
        result = solve_intrinsics(views, SIZE)
    except CalibrationError:
        return
    assert_is_finite(result)
    assert result.warnings


def assert_is_finite(result: IntrinsicsResult) -> None:
    assert np.all(np.isfinite(result.camera.matrix))
    assert np.all(np.isfinite(result.camera.distortion))
    assert np.isfinite(result.rms_px)
