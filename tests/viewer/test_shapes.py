"""Lines and sheets of the scene."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.geometry.plane import LaserPlane
from app.geometry.transform import RigidTransform, rotation_about, rotation_from_rvec
from app.viewer.digits import strokes
from app.viewer.rotations import quaternion, turned
from app.viewer.shapes import board_picture, degree_numbers, degree_ticks, fan, sheet
from app.vision.board import BoardSpec

numbers = st.floats(-1.0, 1.0)


@given(st.tuples(numbers, numbers, numbers), st.tuples(numbers, numbers, numbers))
def test_a_sheet_lies_in_its_plane_and_in_the_box(
    normal: tuple[float, ...], offset: tuple[float, ...]
) -> None:
    if np.linalg.norm(normal) < 0.1:
        return
    world_from_camera = RigidTransform.from_rvec(np.array(offset), np.array([100.0, -50.0, 30.0]))
    inside = np.array([30.0, -20.0, 60.0])
    plane = LaserPlane.through((world_from_camera.inverse() @ inside[None])[0], np.array(normal))
    outline = sheet(plane, world_from_camera, 100.0, 150.0)
    assert 3 <= len(outline) <= 6
    assert np.abs(plane.signed_distance(world_from_camera.inverse() @ outline)).max() < 1e-6
    assert np.abs(outline[:, :2]).max() <= 100.0 + 1e-9
    assert outline[:, 2].min() >= -1e-9
    assert outline[:, 2].max() <= 150.0 + 1e-9
    assert fan(len(outline)).shape == (len(outline) - 2, 3)


def test_a_laser_that_misses_the_table_has_no_sheet() -> None:
    far = LaserPlane(np.array([0.0, 0.0, 1.0]), 1000.0)
    assert sheet(far, RigidTransform.identity(), 100.0, 150.0).shape == (0, 3)


@given(st.tuples(numbers, numbers, numbers))
def test_a_quaternion_turns_as_its_matrix_does(rvec: tuple[float, ...]) -> None:
    rotation = rotation_from_rvec(3.0 * np.array(rvec))
    w, x, y, z = quaternion(rotation)
    axis = np.array([x, y, z])
    vector = np.array([0.3, -1.2, 2.0])
    rotated = vector + 2.0 * w * np.cross(axis, vector) + 2.0 * np.cross(axis, np.cross(axis, vector))
    np.testing.assert_allclose(rotated, rotation @ vector, atol=1e-6)


def test_the_table_turns_counter_clockwise() -> None:
    rotation = rotation_about(np.array([0.0, 0.0, 1.0]), 0.7)
    np.testing.assert_allclose(turned(0.7), quaternion(rotation), atol=1e-12)


def test_ticks_and_degrees_stand_on_the_table() -> None:
    for lines in (degree_ticks(80.0), degree_numbers(80.0)):
        assert np.linalg.norm(lines[..., :2], axis=-1).max() <= 80.0 + 1e-3
        assert (lines[..., 2] > 0.0).all()
    assert len(degree_ticks(80.0)) == 72


@pytest.mark.parametrize(("number", "lines"), [(1, 2), (8, 7), (270, 14), (315, 12)])
def test_numbers_have_the_strokes_of_their_digits(number: int, lines: int) -> None:
    drawn = strokes(number)
    assert len(drawn) == lines
    assert np.abs(drawn[..., 1]).max() == 1.0


def test_degrees_are_read_from_outside() -> None:
    """Seen from the angle 0, the number 45 stands further to the right than 0, and its 5 right of its 4."""
    flat = strokes(45)
    four, five = flat[:4], flat[4:]
    assert four[..., 0].max() < five[..., 0].min()
    numbers = degree_numbers(100.0)
    at_45 = numbers[len(strokes(0)) : len(strokes(0)) + len(flat)]
    counter_clockwise = np.arctan2(at_45[..., 1], at_45[..., 0])
    assert counter_clockwise[:4].max() < counter_clockwise[4:].min()


@pytest.mark.parametrize(
    ("spec", "size"),
    [
        (BoardSpec("chessboard", 9, 6, 8.0), (7, 10)),
        (BoardSpec("charuco", 9, 6, 8.0, 6.0, "DICT_4X4_50"), (6, 9)),
        (BoardSpec("circles", 7, 5, 8.0), (5, 7)),
        (BoardSpec("asymmetric_circles", 4, 11, 8.0), (11, 8)),
    ],
)
def test_boards_look_like_what_they_are(spec: BoardSpec, size: tuple[int, int]) -> None:
    picture = board_picture(spec, 10)
    assert picture.shape == (size[0] * 10, size[1] * 10, 3)
    assert {40, 225} == set(np.unique(picture))
    drawn = spec.outline()[2] - spec.outline()[0]
    assert picture.shape[1] / picture.shape[0] == pytest.approx(drawn[0] / drawn[1], rel=0.01)
