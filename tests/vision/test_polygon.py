"""A part of the picture that is drawn by hand."""

import numpy as np
import pytest

from app.vision.polygon import is_polygon, polygon_mask

_LEFT = ((0.0, 0.0), (0.5, 0.0), (0.5, 1.0), (0.0, 1.0))


@pytest.mark.parametrize("size", [(320, 240), (64, 48)])
def test_the_same_corners_mean_the_same_part_of_a_picture_of_any_size(size: tuple[int, int]) -> None:
    mask = polygon_mask(_LEFT, size)
    width, height = size
    assert mask.shape == (height, width)
    assert mask[:, : width // 2].all()
    assert not mask[:, width // 2 + 1 :].any()


def test_two_corners_too_many_or_some_outside_are_no_part_of_a_picture() -> None:
    assert is_polygon(())
    assert is_polygon(_LEFT)
    for wrong in ([(0, 0), (1, 1)], [(0, 0), (2, 0), (0, 1)], [(0.1, 0.1)] * 65, "nose", [(0, np.nan)] * 3):
        assert not is_polygon(wrong)
