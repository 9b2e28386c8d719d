"""What is painted lies where it belongs, can be seen by everybody, and harms nothing else."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from app.geometry.arrays import Floats
from app.vision import overlay
from app.vision.board import BoardObservation
from app.vision.markers import MarkerObservation
from app.vision.overlay import Marks, painted, shrunk, with_notice
from app.vision.stripe import Image, LaserStripe

_SIZE = (320, 240)
# How people without red or green cones see linear RGB (Machado, Oliveira and Fernandes, 2009, severity 1).
_PROTANOPIA = [
    [0.152286, 1.052583, -0.204868],
    [0.114503, 0.786281, 0.099216],
    [-0.003882, -0.048116, 1.051998],
]
_DEUTERANOPIA = [
    [0.367322, 0.860646, -0.227968],
    [0.280085, 0.672501, 0.047413],
    [-0.011820, 0.042940, 0.968881],
]


def test_a_stripe_is_painted_where_it_is() -> None:
    stripe = upright_stripe(100.3)
    changed = is_changed(painted(grey_scene(), Marks((stripe,))))
    columns = np.flatnonzero(changed.any(axis=0))
    assert columns.min() >= 95
    assert columns.max() <= 106
    assert changed[20:220].any(axis=1).all()
    assert not changed[:10].any()


def test_a_smaller_picture_has_the_stripe_at_the_same_place() -> None:
    stripe = upright_stripe(200.0)
    canvas = painted(grey_scene(), Marks((stripe,)), 160)
    assert canvas.shape == (120, 160, 3)
    plain = shrunk(grey_scene(), 160)
    weights = np.abs(canvas.astype(int) - plain[:, :, None]).sum(axis=(0, 2))
    assert np.average(np.arange(160), weights=weights) == pytest.approx((200.0 + 0.5) / 2.0 - 0.5, abs=0.6)


def test_a_gap_between_two_pieces_of_stripe_stays_open() -> None:
    stripe = upright_stripe(100.0, segment_at=120)
    stripe = stripe.select(np.abs(stripe.line - 120) > 20)
    assert not is_changed(painted(grey_scene(), Marks((stripe,))))[106:134].any()


def test_clipped_rows_are_marked_on_the_stripe_and_at_the_edge() -> None:
    stripe = upright_stripe(100.0, clipped=slice(80, 120))
    plain = painted(grey_scene(), Marks((upright_stripe(100.0),)))
    difference = cv2.absdiff(painted(grey_scene(), Marks((stripe,))), plain)
    marked: NDArray[np.bool_] = np.asarray(difference.max(axis=2), np.uint8) > 0
    rows = stripe.line[80:120]
    assert marked[rows, :20].any(axis=1).all()
    assert marked[rows, 90:110].any(axis=1).all()
    assert not marked[rows[-1] + 8 :].any()


def test_clipped_rows_of_a_lying_stripe_are_marked_at_the_upper_edge() -> None:
    upright = upright_stripe(100.0, clipped=slice(80, 120))
    lying = LaserStripe(
        upright.pixels[:, ::-1].copy(), upright.line, upright.strength, upright.variance, upright.width,
        upright.second, upright.segment, upright.saturated,
    )  # fmt: skip
    changed = is_changed(painted(grey_scene(), Marks((lying,))))
    assert changed[:12, lying.line[80:120]].any(axis=0).all()
    assert not changed[30:70, :10].any()


def test_a_single_clipped_row_can_be_seen() -> None:
    one = upright_stripe(100.0, clipped=slice(50, 51))
    assert is_changed(painted(grey_scene(), Marks((one,))))[:, :12].any()


def test_board_corners_are_ringed_and_the_first_one_stands_out() -> None:
    corners = np.array([[60.0, 60.0], [120.0, 60.0], [60.0, 120.0], [120.0, 120.0]])
    board = BoardObservation(np.array([3, 2, 1, 0]), corners, np.zeros((4, 3)))
    changed = is_changed(painted(grey_scene(), Marks(board=board)))
    amount = [changed[int(v) - 12 : int(v) + 13, int(u) - 12 : int(u) + 13].sum() for u, v in corners]
    assert min(amount) > 20
    assert np.argmax(amount) == 3


def test_markers_are_framed() -> None:
    square = np.array([[[40.0, 40.0], [90.0, 40.0], [90.0, 90.0], [40.0, 90.0]]])
    changed = is_changed(painted(grey_scene(), Marks(markers=MarkerObservation(np.array([7]), square))))
    assert changed[40, 45:85].all()
    assert changed[45:85, 90].all()
    assert changed[55:75, 55:75].any()
    assert not changed[100:].any()


def test_outlines_are_dashed_and_end_where_they_cannot_be_seen() -> None:
    line = np.array([[-1e7, 50.0], [np.nan, np.nan], [10.0, 50.0], [300.0, 50.0], [1e9, 1e9]])
    changed = is_changed(painted(grey_scene(), Marks(outlines=(line,))))
    assert 0.2 < changed[50, 10:300].mean() < 0.9
    assert not changed[:40].any()
    assert not changed[60:].any()


def test_a_picture_without_marks_stays_as_it_is_and_the_given_one_always_does() -> None:
    scene = colour_scene()
    before = scene.copy()
    assert np.array_equal(painted(scene, Marks()), scene)
    painted(scene, Marks((upright_stripe(50.0),), captions=("left: 3 rows",)))
    assert np.array_equal(scene, before)


def test_nothing_found_paints_nothing() -> None:
    none = MarkerObservation(np.zeros(0, np.intp), np.zeros((0, 4, 2)))
    outlines = (np.full((3, 2), np.nan), np.zeros((0, 2)))
    marks = Marks((LaserStripe.empty(),), BoardObservation.empty(), none, outlines)
    assert np.array_equal(painted(colour_scene(), marks), colour_scene())


def test_pictures_are_never_enlarged() -> None:
    scene = colour_scene()
    assert shrunk(scene, None) is scene
    assert shrunk(scene, 321) is scene
    assert shrunk(scene, 200).shape == (150, 200, 3)
    assert shrunk(np.zeros((3, 1000), np.uint8), 10).shape == (1, 10)


def test_a_notice_dims_the_picture_and_is_readable_on_white() -> None:
    white = np.full((240, 320, 3), 255, np.uint8)
    noticed = with_notice(white, ("No picture.", "camera: has gone"))
    assert noticed[:60].max() < 100
    assert noticed[100:140].max() > 200


def test_words_too_long_for_the_picture_are_cut_and_strange_letters_replaced() -> None:
    small = np.zeros((60, 80), np.uint8)
    noticed = with_notice(small, ("camera: überlanger Text " * 10,))
    assert noticed.shape == (60, 80, 3)
    assert noticed.max() > 200


@pytest.mark.parametrize("cones", [_PROTANOPIA, _DEUTERANOPIA, np.eye(3)])
def test_stripes_and_what_is_clipped_look_different_to_everybody(cones: object) -> None:
    colours = [overlay._SKY_BLUE, overlay._YELLOW, overlay._VERMILLION, overlay._WHITE]
    seen = [as_seen(colour, np.array(cones)) for colour in colours]
    for k, one in enumerate(seen):
        for other in seen[k + 1 :]:
            assert np.linalg.norm(one - other) > 60.0


def as_seen(colour: tuple[int, int, int], cones: Floats) -> Floats:
    """sRGB 0..255 as somebody with these cones sees it."""
    linear = (np.array(colour[::-1]) / 255.0) ** 2.2
    seen: Floats = 255.0 * np.clip(cones @ linear, 0.0, 1.0) ** (1.0 / 2.2)
    return seen


def grey_scene() -> Image:
    return np.full((_SIZE[1], _SIZE[0]), 40, np.uint8)


def colour_scene() -> Image:
    return np.random.default_rng(1).integers(0, 200, (_SIZE[1], _SIZE[0], 3), np.uint8)


def upright_stripe(column: float, *, clipped: slice | None = None, segment_at: int = 10**6) -> LaserStripe:
    """Rows 20 to 220, one point each."""
    line = np.arange(20, 221)
    n = len(line)
    saturated = np.zeros(n, np.bool_)
    if clipped is not None:
        saturated[clipped] = True
    one = np.ones(n)
    return LaserStripe(
        np.column_stack([np.full(n, column), line.astype(np.float64)]), line, 100.0 * one, 0.01 * one,
        2.0 * one, 0.0 * one, (line >= segment_at).astype(np.intp), saturated,
    )  # fmt: skip


def is_changed(canvas: Image) -> NDArray[np.bool_]:
    """Where a painted grey scene is not grey any more."""
    changed: NDArray[np.bool_] = (canvas != 40).any(axis=2)
    return changed
