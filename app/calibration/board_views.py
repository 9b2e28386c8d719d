"""The board in each view: where it stands, and which stripe points fall on it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from app.calibration.lit_together import swapped_pairs
from app.calibration.poses import BoardPose, board_pose, points_on_board, stripe_on_board
from app.calibration.print_edges import clear_of_edges
from app.calibration.views import Evidence, View
from app.geometry.arrays import Points
from app.geometry.camera import CameraIntrinsics
from app.vision.stripe import LaserStripe

_FEWEST_STRIPE_POINTS = 12
_WORST_VIEW_PX = 2.0


@dataclass(frozen=True, eq=False, slots=True)
class BoardView:
    """A view of the board with its pose and the stripe points that fall on it."""

    view: View
    pose: BoardPose
    stripes: Mapping[str, LaserStripe]

    def points(self, camera: CameraIntrinsics, laser: str) -> Points:
        """The stripe's points (N, 3) mm in the camera frame."""
        return points_on_board(camera, self.pose.camera_from_board, self.stripes[laser].pixels)


def board_views(
    evidence: Evidence, camera: CameraIntrinsics, excluded: frozenset[str] = frozenset()
) -> tuple[list[BoardView], list[tuple[str, str]]]:
    """Pose of the board in every view that shows it, and which stripe points fall on it.

    Args:
        excluded: names of views that another step found to be bad.

    Returns:
        the usable views, and those left out with the reason.
    """
    seen: list[BoardView] = []
    dropped: list[tuple[str, str]] = []
    for view in evidence.views:
        if not view.board.is_found or view.name in excluded or evidence.board is None:
            continue
        pose = board_pose(camera, view.board.corners, view.board.board_points)
        if pose.rms_px > _WORST_VIEW_PX:
            dropped.append((view.name, f"the board fits to {pose.rms_px:.1f} px only"))
            continue
        stripes = {}
        for laser, stripe in view.stripes.items():
            lies_on = stripe_on_board(camera, pose.camera_from_board, evidence.board, stripe.pixels)
            on_board = stripe.select(lies_on)
            is_clear = clear_of_edges(
                camera, pose.camera_from_board, evidence.board, on_board, view.across_of(laser)
            )
            if np.count_nonzero(is_clear) >= _FEWEST_STRIPE_POINTS:
                stripes[laser] = on_board.select(is_clear)
        seen.append(BoardView(view, pose, stripes))
    return _told_apart(seen, camera), dropped


def _told_apart(boards: list[BoardView], camera: CameraIntrinsics) -> list[BoardView]:
    """The same views, each stripe given to its laser where two were lit in one picture."""
    for names in {board.view.together for board in boards if len(board.view.together) == 2}:
        shared = [
            k for k, b in enumerate(boards) if b.view.together == names and b.stripes.keys() >= set(names)
        ]
        pairs = [(boards[k].points(camera, names[0]), boards[k].points(camera, names[1])) for k in shared]
        across = boards[shared[0]].view.across_of(names[0]) if shared else 0
        for k, is_swapped in zip(shared, swapped_pairs(pairs, across), strict=True):
            if is_swapped:
                stripes = dict(boards[k].stripes)
                stripes[names[0]], stripes[names[1]] = stripes[names[1]], stripes[names[0]]
                boards[k] = replace(boards[k], stripes=stripes)
    return boards
