"""Where the board was, from the views on disk."""

import numpy as np

from app.geometry.arrays import Pixels
from app.geometry.transform import RigidTransform
from app.jobs.calibrate_boards import boards_of
from app.jobs.calibrate_state import Step
from app.jobs.calibrate_views import TakenView
from app.simulation.poses import fitting_board
from app.simulation.rig import standard_rig

RIG = standard_rig(640, 480).rig


def test_the_board_is_drawn_where_it_was_and_a_half_hidden_one_is_left_out() -> None:
    camera = RIG.camera
    spec = fitting_board(RIG)
    points = spec.points()
    pose = RigidTransform.from_rvec(np.array([0.3, -0.2, 0.1]), np.array([-40.0, -30.0, 350.0]))
    seen = camera.project(pose @ points)
    views = [_view(0, seen), _view(1, seen[:10])]
    (found,) = boards_of(spec, views, camera)
    np.testing.assert_allclose(found @ points, pose @ points, atol=0.01)


def test_of_many_views_a_few_are_drawn() -> None:
    camera = RIG.camera
    spec = fitting_board(RIG)
    pose = RigidTransform.from_rvec(np.array([0.3, -0.2, 0.1]), np.array([-40.0, -30.0, 350.0]))
    seen = camera.project(pose @ spec.points())
    assert 12 < len(boards_of(spec, [_view(n, seen) for n in range(100)], camera)) <= 24


def _view(number: int, corners: Pixels) -> TakenView:
    return TakenView(number, f"{number}.png", Step.CAMERA, None, None, corners, corners[:4])
