"""Where the board was in the views of a calibration, to be drawn in the 3D view."""

from collections.abc import Callable, Sequence

from app.calibration.poses import board_pose
from app.geometry.camera import CameraIntrinsics
from app.geometry.transform import RigidTransform
from app.jobs.calibrate_views import TakenView
from app.vision.board import BoardSpec

ShowBoards = Callable[[BoardSpec, Sequence[RigidTransform]], None]
"""Draws a board in poses camera_from_board, instead of those there were."""

# More of them hide each other.
_MOST = 24


def boards_of(
    spec: BoardSpec, views: Sequence[TakenView], camera: CameraIntrinsics
) -> tuple[RigidTransform, ...]:
    """camera_from_board of views that show the whole board, spread over all of them.

    Args:
        spec: the board.
        views: in the order in which they were taken.
        camera: as it was found.
    """
    points = spec.points()
    whole = [view for view in views if len(view.corners) == len(points)]
    step = -(-len(whole) // _MOST) if whole else 1
    return tuple(board_pose(camera, view.corners, points).camera_from_board for view in whole[::step])
