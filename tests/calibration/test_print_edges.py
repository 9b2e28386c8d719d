import numpy as np
from numpy.testing import assert_array_equal

from app.calibration.print_edges import clear_of_edges
from app.geometry.camera import CameraIntrinsics
from app.geometry.transform import RigidTransform
from app.vision.board import BoardSpec
from app.vision.stripe import LaserStripe

_CAMERA = CameraIntrinsics(
    np.array([[1000.0, 0.0, 320.0], [0.0, 1000.0, 240.0], [0.0, 0.0, 1.0]]), np.zeros(5), (640, 480)
)
_BOARD = BoardSpec("chessboard", 5, 4, 10.0)
# Straight before the camera, 4 px to the millimetre; the first corner is seen at (240, 180).
_POSE = RigidTransform(np.eye(3), np.array([-20.0, -15.0, 250.0]))
_EVERY_ROW = np.arange(480.0)


def _stripe(column: float, sigma_px: float = 2.0) -> LaserStripe:
    n = len(_EVERY_ROW)
    flat = np.ones(n)
    return LaserStripe(
        np.column_stack([np.full(n, column), _EVERY_ROW]), _EVERY_ROW.astype(np.intp), 100.0 * flat,
        0.01 * flat, sigma_px * flat, 0.0 * flat, np.zeros(n, np.intp), np.zeros(n, np.bool_),
    )  # fmt: skip


def _clear(stripe: LaserStripe, across: int = 0, board: BoardSpec = _BOARD) -> np.ndarray:
    return clear_of_edges(_CAMERA, _POSE, board, stripe, across)


def test_a_stripe_through_the_middles_of_squares_loses_only_the_rows_at_the_edges_it_crosses() -> None:
    # Edges of the squares lie at rows 140, 180, ... 340; the blur reaches one row and a half.
    near_edge = np.abs((_EVERY_ROW - 140.0 + 20.0) % 40.0 - 20.0) < 1.6
    in_pattern = (_EVERY_ROW > 138.0) & (_EVERY_ROW < 342.0)
    assert_array_equal(_clear(_stripe(260.0)), ~(near_edge & in_pattern))


def test_a_stripe_along_an_edge_keeps_nothing_of_the_pattern() -> None:
    clear = _clear(_stripe(243.0))
    assert not clear[140:341].any()
    assert clear[:138].all()
    assert clear[343:].all()


def test_a_stripe_beside_the_pattern_is_clear_everywhere() -> None:
    assert _clear(_stripe(190.0)).all()


def test_a_narrow_stripe_may_lie_nearer_to_an_edge_than_a_wide_one() -> None:
    assert _clear(_stripe(244.0, sigma_px=1.0))[150:170].all()
    assert not _clear(_stripe(244.0, sigma_px=2.5))[150:170].any()


def test_a_stripe_as_wide_as_the_squares_keeps_their_middles() -> None:
    assert _clear(_stripe(260.0, sigma_px=15.0))[150:170].all()


def test_a_stripe_across_the_picture_is_kept_clear_of_the_edges_above_and_below_it() -> None:
    along_row = LaserStripe(
        np.array([[260.0, 183.0], [260.0, 200.0]]), np.array([260, 261]), np.full(2, 100.0),
        np.full(2, 0.01), np.full(2, 2.0), np.zeros(2), np.zeros(2, np.intp), np.zeros(2, np.bool_),
    )  # fmt: skip
    assert_array_equal(_clear(along_row, across=1), [False, True])


def test_a_board_of_dots_keeps_the_whole_stripe() -> None:
    assert _clear(_stripe(243.0), board=BoardSpec("circles", 5, 4, 10.0)).all()


def test_a_charuco_board_keeps_half_of_its_squares_and_none_that_holds_a_marker() -> None:
    chessboard = BoardSpec("chessboard", 5, 4, 10.0)
    charuco = BoardSpec("charuco", 6, 5, 10.0, 7.0, "DICT_4X4_50")
    for column in (261.0, 300.0):
        in_squares = _clear(_stripe(column), board=chessboard)
        kept = _clear(_stripe(column), board=charuco)
        assert not (kept & ~in_squares).any()
        assert 0 < np.count_nonzero(kept) < np.count_nonzero(in_squares)


def test_no_stripe_gives_an_empty_mask() -> None:
    assert len(_clear(LaserStripe.empty())) == 0
