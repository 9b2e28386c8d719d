"""Markers on the platter are found, told apart and located."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from board_pictures import noisy, rasterised, seen_through
from numpy.testing import assert_array_equal

from app.calibration.board_print import draw_platter
from app.errors import OptionError
from app.vision.markers import PlatterSpec, detect_markers

PLATTER = PlatterSpec("DICT_4X4_50", 24.0, (3, 7, 11, 20, 30))


def sheet(spec: PlatterSpec) -> np.ndarray:
    return rasterised(draw_platter(spec, 160.0), 8, (0.0, 0.0, 160.0, 160.0))


def test_corners_of_slanted_markers_lie_where_they_are_printed() -> None:
    printed = sheet(PLATTER)
    corners = np.array([[0, 0], [1280, 0], [1280, 1280], [0, 1280]], np.float32)
    places = np.array([[150, 80], [500, 90], [620, 420], [20, 400]], np.float32)
    turned = np.asarray(cv2.getPerspectiveTransform(corners, places), np.float64)
    image = noisy(seen_through(printed, turned, (640, 480)), 2.0)
    seen = detect_markers(image, PLATTER)
    assert_array_equal(seen.ids, PLATTER.ids)

    flat = detect_markers(printed, PLATTER)
    truth = cv2.perspectiveTransform(flat.corners.reshape(-1, 1, 2) + 0.5, turned).reshape(-1, 4, 2)
    off = np.linalg.norm(seen.corners - truth, axis=2)
    assert np.sqrt(np.mean(off**2)) < 0.15


def test_markers_that_are_not_on_the_list_are_left_out() -> None:
    listed = PlatterSpec("DICT_4X4_50", 24.0, (7, 20))
    assert_array_equal(detect_markers(sheet(PLATTER), listed).ids, [7, 20])


def test_a_marker_that_is_seen_twice_is_not_believed() -> None:
    twice = np.hstack([sheet(PLATTER), sheet(PlatterSpec("DICT_4X4_50", 24.0, (3, 40, 41)))])
    assert_array_equal(detect_markers(twice, PLATTER).ids, [7, 11, 20, 30])


def test_a_picture_without_markers_gives_an_empty_observation() -> None:
    seen = detect_markers(np.full((100, 120, 3), 80, np.uint8), PLATTER)
    assert not seen.is_found
    assert seen.corners.shape == (0, 4, 2)


def test_an_unknown_dictionary_is_named() -> None:
    with pytest.raises(OptionError, match="DICT_3X3"):
        detect_markers(np.zeros((50, 50), np.uint8), PlatterSpec("DICT_3X3", 10.0, (1,)))


def test_the_turntable_shows_its_four_markers_in_nearly_every_frame(shared_data: Path) -> None:
    platter = PlatterSpec("DICT_4X4_50", 30.0, (5, 18, 27, 42))
    frames = sorted((shared_data / "turntable-green" / "frames").glob("table_*.jpg"))
    counts = [
        len(detect_markers(np.asarray(cv2.imread(str(frame)), np.uint8), platter).ids) for frame in frames
    ]
    assert len(counts) == 160
    assert min(counts) >= 3
    assert counts.count(4) >= 156
