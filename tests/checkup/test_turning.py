"""How far a table turned is told by two pictures of its corners, whatever the camera."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.checkup.target import Corners, Target
from app.checkup.turning import Sway, guessed_camera, turned_deg
from app.geometry.arrays import Pixels
from app.geometry.transform import RigidTransform, rotation_about
from app.simulation.rig import standard_rig
from app.vision.board import BoardSpec
from app.vision.markers import PlatterSpec

PLATTER = Target(PlatterSpec("DICT_4X4_50", 14.0, (0, 1, 2)))
BOARD = BoardSpec("charuco", 9, 7, 9.0, 6.75, "DICT_4X4_50")
RIG = standard_rig().rig
UP = np.array([0.0, 0.0, 1.0])


def markers(angle_deg: float, noise_px: float = 0.0) -> Corners:
    """Corners of three markers on the near side of a turning table."""
    rng = np.random.default_rng(round(1e3 * abs(angle_deg)))
    square = 7.0 * np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    seen = {}
    for number, middle in enumerate(([55.0, 0.0, 0.0], [20.0, 50.0, 0.0], [30.0, -45.0, 0.0])):
        seen[number] = pixels(square + middle, angle_deg) + noise_px * rng.standard_normal((4, 2))
    return seen


def pixels(on_table: np.ndarray, angle_deg: float) -> Pixels:
    return RIG.camera.project(RIG.axis.table_from_camera(np.radians(angle_deg)).inverse() @ on_table)


def board(angle_deg: float) -> Corners:
    """A board that stands on the table and leans back a little."""
    lean = np.radians(80.0)
    upright = np.column_stack([[0.0, 1.0, 0.0], [np.cos(lean), 0.0, -np.sin(lean)], np.zeros(3)])
    upright[:, 2] = np.cross(upright[:, 0], upright[:, 1])
    table_from_board = RigidTransform(upright, np.array([10.0, -30.0, 55.0]))
    seen = pixels(table_from_board @ BOARD.points(), angle_deg)
    return {number: corner[None] for number, corner in enumerate(seen)}


@given(st.floats(4.0, 40.0), st.sampled_from([1.0, -1.0]))
def test_markers_tell_angle_and_direction_without_a_calibration(size_deg: float, way: float) -> None:
    found = turned_deg(PLATTER, markers(0.0), markers(way * size_deg), guessed_camera((1280, 720)))

    assert found == pytest.approx(way * size_deg, rel=0.06)


@given(st.floats(6.0, 30.0), st.sampled_from([1.0, -1.0]))
def test_a_board_tells_them_roughly_with_a_guessed_camera(size_deg: float, way: float) -> None:
    found = turned_deg(
        Target(BOARD), board(-10.0), board(-10.0 + way * size_deg), guessed_camera((1280, 720))
    )

    assert found == pytest.approx(way * size_deg, rel=0.15)


def test_a_single_marker_does_not_tell() -> None:
    one, other = ({0: markers(angle)[0]} for angle in (0.0, 10.0))

    assert np.isnan(turned_deg(PLATTER, one, other, guessed_camera((1280, 720))))


@given(st.floats(-4.0, 4.0))
def test_a_small_turn_is_measured_in_the_degrees_that_the_board_is_told(off_deg: float) -> None:
    # The board is told twice what the table turns.
    sway = Sway.between(markers(-3.0), markers(0.0), markers(3.0), 12.0)

    assert sway.off_deg(markers(off_deg)) == pytest.approx(2.0 * off_deg, rel=0.02, abs=1e-6)


def test_noise_of_a_fifth_of_a_pixel_leaves_a_fiftieth_of_a_degree() -> None:
    sway = Sway.between(markers(-3.0, 0.2), markers(0.0, 0.2), markers(3.0, 0.2), 6.0)

    assert sway.off_deg(markers(0.001, 0.2)) == pytest.approx(0.0, abs=0.03)


def test_a_corner_that_was_found_wrong_does_not_count() -> None:
    sway = Sway.between(markers(-3.0, 0.05), markers(0.0, 0.05), markers(3.0, 0.05), 6.0)
    seen = {number: corners.copy() for number, corners in markers(1.0, 0.05).items()}
    seen[0][1] += 25.0

    assert sway.off_deg(seen) == pytest.approx(1.0, abs=0.05)


def test_nothing_is_told_where_no_corner_is_seen_again() -> None:
    sway = Sway.between(markers(-3.0), markers(0.0), markers(3.0), 6.0)

    assert np.isnan(sway.off_deg({}))
    assert np.isnan(Sway.between({}, {}, {}, 6.0).speed_px)


def test_corners_of_a_table_that_turns_move_by_their_distance_from_the_axis() -> None:
    sway = Sway.between(markers(-0.5), markers(0.0), markers(0.5), 1.0)

    # 50 mm from the axis, 300 mm from a camera with f = 1400: 4 pixels a degree, some foreshortened.
    assert 2.0 < sway.speed_px < 6.0
    assert rotation_about(UP, 0.0) == pytest.approx(np.eye(3))
