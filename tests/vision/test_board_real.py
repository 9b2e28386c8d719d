"""Boards in real pictures."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from app.vision.board import BoardObservation, BoardSpec, detect_board


def seen_in(paths: list[Path], spec: BoardSpec) -> list[BoardObservation]:
    return [detect_board(np.asarray(cv2.imread(str(path)), np.uint8), spec) for path in paths]


def test_every_board_with_a_green_stripe_across_it_is_found(shared_data: Path) -> None:
    seen = seen_in(
        sorted((shared_data / "stripe-on-board").glob("*.jpg")), BoardSpec("chessboard", 8, 6, 40.0)
    )
    assert len(seen) == 6
    assert all(len(one.ids) >= 40 for one in seen)


def test_the_board_is_found_in_all_camera_views_of_the_turntable(shared_data: Path) -> None:
    frames = sorted((shared_data / "turntable-green" / "frames").glob("camera_*.jpg"))
    seen = seen_in(frames, BoardSpec("chessboard", 8, 6, 40.0))
    assert [len(one.ids) >= 47 for one in seen] == [True] * 27


def test_the_board_is_found_in_every_laser_view_that_holds_all_of_it(shared_data: Path) -> None:
    frames = sorted((shared_data / "turntable-green" / "frames").glob("laser_*.jpg"))
    seen = seen_in(frames, BoardSpec("chessboard", 8, 6, 40.0))
    missed = [frame.stem[-3:] for frame, one in zip(frames, seen, strict=True) if not one.is_found]
    # In these nine the picture's edge cuts the board.
    assert missed == ["047", "065", "068", "083", "086", "110", "113", "116", "128"]


@pytest.mark.parametrize(
    ("name", "corners"),
    [
        ("img_00", 24), ("img_01", 24), ("img_02", 24), ("img_03", 24),
        ("choriginal", 24), ("chocclusion_original", 16),
    ],
)  # fmt: skip
def test_charuco_pictures_show_as_many_corners_as_others_found(
    shared_data: Path, name: str, corners: int
) -> None:
    spec = BoardSpec("charuco", 5, 7, 40.0, 20.0, "DICT_6X6_250")
    (seen,) = seen_in([shared_data / "opencv" / "charuco" / f"{name}.jpg"], spec)
    assert len(seen.ids) == corners
