"""Boards are found, numbered as printed and located to a fraction of a pixel."""

import cv2
import numpy as np
import pytest
from board_pictures import camera, noisy, picture
from numpy.testing import assert_allclose, assert_array_equal

from app.errors import OptionError
from app.vision.board import BoardObservation, BoardSpec, detect_board

CHESSBOARD = BoardSpec("chessboard", 9, 6, 20.0)
AMBIGUOUS = BoardSpec("chessboard", 8, 6, 20.0)
CHARUCO = BoardSpec("charuco", 7, 5, 28.0, 20.0, "DICT_4X4_50")
CIRCLES = BoardSpec("circles", 7, 5, 24.0)
STAGGERED = BoardSpec("asymmetric_circles", 4, 11, 15.0)
KINDS = [CHESSBOARD, AMBIGUOUS, CHARUCO, CIRCLES, STAGGERED, BoardSpec("asymmetric_circles", 4, 10, 15.0)]


def errors_px(seen: BoardObservation, corners: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.norm(seen.corners - corners[seen.ids], axis=1))


@pytest.mark.parametrize("spec", KINDS, ids=lambda spec: spec.description)
@pytest.mark.parametrize("tilt", [(0.0, 0.0, 0.0), (30.0, -25.0, 8.0), (-20.0, 40.0, -15.0)])
def test_corners_lie_where_the_board_is_printed(spec: BoardSpec, tilt: tuple[float, float, float]) -> None:
    scene = picture(spec, tilt)
    seen = detect_board(scene.image, spec)
    assert len(seen.ids) >= 0.9 * len(spec.points())
    assert np.sqrt(np.mean(errors_px(seen, scene.corners) ** 2)) < 0.08
    assert_allclose(seen.board_points, spec.points()[seen.ids])


@pytest.mark.parametrize("spec", KINDS, ids=lambda spec: spec.description)
def test_numbers_stay_with_the_corners_when_the_board_rolls(spec: BoardSpec) -> None:
    for roll in (60.0, 90.0, 135.0, 180.0, 275.0):
        scene = picture(spec, (15.0, 20.0, roll), 520.0)
        seen = detect_board(scene.image, spec)
        assert seen.is_found
        either = [seen, spec.flipped(seen)] if spec.is_ambiguous else [seen]
        assert min(errors_px(one, scene.corners).max() for one in either) < 0.5


def test_the_rows_of_an_ambiguous_board_run_to_the_right_or_down() -> None:
    for roll in (-40.0, 0.0, 90.0, 130.0):
        scene = picture(AMBIGUOUS, (10.0, 10.0, roll), 520.0)
        assert errors_px(detect_board(scene.image, AMBIGUOUS), scene.corners).max() < 0.5


@pytest.mark.parametrize("columns", [3, 4, 5])
@pytest.mark.parametrize("rows", [4, 6, 7])
def test_a_chessboard_is_ambiguous_when_half_a_turn_keeps_its_colours(columns: int, rows: int) -> None:
    colours = np.add.outer(np.arange(rows + 1), np.arange(columns + 1)) % 2
    repeats = bool(np.array_equal(colours, colours[::-1, ::-1]))
    assert BoardSpec("chessboard", columns, rows, 10.0).is_ambiguous == repeats


@pytest.mark.parametrize("rows", [4, 5, 10, 11])
def test_a_staggered_grid_is_ambiguous_when_half_a_turn_keeps_its_dots(rows: int) -> None:
    spec = BoardSpec("asymmetric_circles", 4, rows, 10.0)
    dots = spec.points()
    turned = dots.max(axis=0) - dots
    repeats = {tuple(dot) for dot in dots} == {tuple(dot) for dot in turned}
    assert spec.is_ambiguous == repeats


def test_flipping_twice_gives_the_observation_back() -> None:
    seen = detect_board(picture(AMBIGUOUS).image, AMBIGUOUS).select(np.arange(3, 40))
    flipped = AMBIGUOUS.flipped(seen)
    assert_array_equal(np.sort(flipped.ids), flipped.ids)
    back = AMBIGUOUS.flipped(flipped)
    assert_array_equal(back.ids, seen.ids)
    assert_allclose(back.corners, seen.corners)


def test_a_laser_line_across_the_chessboard_spoils_no_corner_that_is_reported() -> None:
    scene = picture(AMBIGUOUS, (20.0, 15.0, 2.0))
    striped = with_stripe(scene.image, column=float(scene.corners[3::8, 0].mean()) + 3.0)
    seen = detect_board(striped, AMBIGUOUS)
    assert len(seen.ids) >= 36
    assert errors_px(seen, scene.corners).max() < 0.5


def test_a_chessboard_with_a_corner_in_the_shade_is_found() -> None:
    scene = picture(CHESSBOARD, (20.0, 15.0, 2.0), noise=0.0)
    v, u = np.mgrid[0:480, 0:640]
    light = 1.0 - 0.9 * np.clip((u / 640 + v / 480 - 0.8) / 0.7, 0.0, 1.0)
    seen = detect_board(noisy(scene.image * light, 2.0), CHESSBOARD)
    assert len(seen.ids) >= 50
    assert errors_px(seen, scene.corners).max() < 1.0


def test_a_chessboard_in_a_large_picture_is_located_at_full_size() -> None:
    scene = picture(CHESSBOARD, (25.0, 10.0, 0.0), seen_by=camera((1920, 1440), 2000.0))
    seen = detect_board(scene.image, CHESSBOARD)
    assert len(seen.ids) == 54
    assert errors_px(seen, scene.corners).max() < 0.3


def test_a_partly_hidden_charuco_board_shows_its_other_corners() -> None:
    scene = picture(CHARUCO)
    hidden = scene.image.copy()
    hidden[:, 380:] = 90
    seen = detect_board(hidden, CHARUCO)
    assert 8 <= len(seen.ids) < 24
    assert errors_px(seen, scene.corners).max() < 0.4
    assert np.all(seen.corners[:, 0] < 381)


def test_a_charuco_board_of_the_older_pattern_is_found() -> None:
    spec = BoardSpec("charuco", 5, 6, 20.0, 14.0, "DICT_5X5_100")
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    board = cv2.aruco.CharucoBoard((5, 6), 20.0, 14.0, dictionary)
    board.setLegacyPattern(True)
    image = np.asarray(board.generateImage((500, 600), marginSize=50), np.uint8)
    seen = detect_board(image, spec)
    assert_array_equal(seen.ids, np.arange(20))
    spacing = np.diff(seen.corners.reshape(5, 4, 2), axis=1)[..., 0]
    assert spacing.std() < 0.5


def test_white_dots_on_black_are_found_too() -> None:
    scene = picture(CIRCLES)
    seen = detect_board(255 - scene.image, CIRCLES)
    assert min(errors_px(one, scene.corners).max() for one in (seen, CIRCLES.flipped(seen))) < 0.3


def test_strongly_slanted_dots_are_not_shifted() -> None:
    scene = picture(CIRCLES, (0.0, 55.0, 0.0), 300.0, noise=0.5)
    seen = detect_board(scene.image, CIRCLES)
    assert len(seen.ids) == 35
    assert np.abs((seen.corners - scene.corners).mean(axis=0)).max() < 0.03
    assert errors_px(seen, scene.corners).max() < 0.15


@pytest.mark.parametrize("spec", KINDS[:5], ids=lambda spec: spec.description)
def test_a_picture_without_a_board_gives_an_empty_observation(spec: BoardSpec) -> None:
    noise = noisy(np.full((240, 320, 3), 120.0), 25.0)
    for image in (np.zeros((240, 320), np.uint8), noise):
        seen = detect_board(image, spec)
        assert not seen.is_found
        assert seen.corners.shape == (0, 2)
        assert seen.board_points.shape == (0, 3)


def test_the_outline_holds_the_printed_squares() -> None:
    outline = CHESSBOARD.outline(margin_mm=5.0)
    assert_allclose(outline[0], [-25.0, -25.0, 0.0])
    assert_allclose(outline[2], [9 * 20.0 + 5.0, 6 * 20.0 + 5.0, 0.0])


@pytest.mark.parametrize(
    "spec",
    [
        BoardSpec("chessboard", 2, 6, 20.0),
        BoardSpec("chessboard", 9, 6, float("nan")),
        BoardSpec("chessboard", 9, 6, -1.0),
        BoardSpec("charuco", 5, 7, 20.0, 20.0, "DICT_4X4_50"),
        BoardSpec("charuco", 5, 7, 20.0, 15.0, "DICT_9X9_50"),
        BoardSpec("charuco", 20, 20, 20.0, 15.0, "DICT_4X4_50"),
        BoardSpec("circles", 1, 5, 20.0),
        BoardSpec("circles", 5, 500, 20.0),
    ],
)
def test_a_board_that_cannot_be_is_refused_with_a_sentence(spec: BoardSpec) -> None:
    with pytest.raises(OptionError) as refused:
        spec.check()
    assert refused.value.hint
    assert refused.value.message.endswith(".")


def with_stripe(grey: np.ndarray, column: float) -> np.ndarray:
    """A green line with a saturated core and a glow, in colour, leaning a little."""
    height, width = grey.shape
    v, u = np.mgrid[0:height, 0:width]
    off = u - column - 0.05 * (v - height / 2)
    light = np.repeat(grey[..., None].astype(np.float64), 3, axis=2)
    light[..., 1] += 250.0 * np.exp(-(off**2) / 8.0) + 40.0 * np.exp(-(off**2) / 800.0)
    light[..., 0] += 40.0 * np.exp(-(off**2) / 5.0)
    light[..., 2] += 40.0 * np.exp(-(off**2) / 5.0)
    return np.clip(np.rint(light), 0, 255).astype(np.uint8)
