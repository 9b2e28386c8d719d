"""How far a table turned between two pictures of the same corners, without a calibration."""

from dataclasses import dataclass

import cv2
import numpy as np

from app.calibration.poses import board_pose
from app.checkup.target import Corners, Target, in_common
from app.geometry.camera import CameraIntrinsics
from app.vision.board import BoardSpec

_FEWEST_CORNERS = 6
# Places that hardly move beside the others tell nothing of the turn.
_OUTLIER_SIGMAS = 4.0
_USUAL_FOCAL_WIDTHS = 1.0


@dataclass(frozen=True, eq=False, slots=True)
class Sway:
    """A small turn about one stance of the table, as every corner moves in the picture.

    Attributes:
        at: corners at the stance.
        per_deg: (n, 2) px by which each of them moves for one degree that the board is told.
    """

    at: Corners
    per_deg: Corners

    @classmethod
    def between(cls, before: Corners, at: Corners, after: Corners, told_deg: float) -> "Sway":
        """From pictures on both sides of a stance, `told_deg` apart."""
        numbers = before.keys() & at.keys() & after.keys()
        return cls(
            {number: at[number] for number in numbers},
            {number: (after[number] - before[number]) / told_deg for number in numbers},
        )

    @property
    def speed_px(self) -> float:
        """How far a typical corner moves for one degree; NaN without corners."""
        if not self.per_deg:
            return float("nan")
        return float(np.median(np.linalg.norm(np.concatenate(list(self.per_deg.values())), axis=1)))

    def off_deg(self, seen: Corners) -> float:
        """How far from the stance the table is in another picture, in degrees as the board is told.

        First order: exact near the stance, some percent short at ten degrees. NaN without enough corners.
        """
        at, now, numbers = in_common(self.at, seen)
        if len(at) < _FEWEST_CORNERS:
            return float("nan")
        slope = np.concatenate([self.per_deg[number] for number in numbers])
        moved = now - at
        keep = np.ones(len(at), np.bool_)
        off = 0.0
        for _ in range(3):
            off = float(np.sum(slope[keep] * moved[keep]) / np.sum(slope[keep] ** 2))
            left = np.linalg.norm(moved - off * slope, axis=1)
            keep = left <= _OUTLIER_SIGMAS * max(float(np.median(left)), 0.05)
        return off


def turned_deg(target: Target, before: Corners, after: Corners, camera: CameraIntrinsics) -> float:
    """Roughly how far the table turned, signed, counter-clockwise seen from above; NaN where it cannot tell.

    Args:
        camera: need be known only for a board; a guess makes an error of some percent.
    """
    if isinstance(target.what, BoardSpec):
        return _turn_of_board(target.what, before, after, camera)
    return _turn_of_plane(before, after)


def guessed_camera(size: tuple[int, int]) -> CameraIntrinsics:
    """A camera as most are: as long in focus as its picture is wide."""
    focal = _USUAL_FOCAL_WIDTHS * max(size)
    matrix = np.array([[focal, 0.0, size[0] / 2 - 0.5], [0.0, focal, size[1] / 2 - 0.5], [0.0, 0.0, 1.0]])
    return CameraIntrinsics(matrix, np.zeros(5), size)


def _turn_of_plane(before: Corners, after: Corners) -> float:
    """The picture of a plane that turns in itself is mapped by a homography similar to a rotation.

    Its eigenvalues are 1 and exp(+-i angle), whatever the camera; which way it turns the corners show.
    """
    one, other, numbers = in_common(before, after)
    # The four corners of a single marker are too near each other.
    if len(numbers) < 2:
        return float("nan")
    middle, spread = one.mean(axis=0), float(one.std())
    mapping, _ = cv2.findHomography((one - middle) / spread, (other - middle) / spread, 0)
    if mapping is None:
        return float("nan")
    values = np.linalg.eigvals(mapping)
    real = values[np.argmin(np.abs(values.imag))].real
    turned = float(np.degrees(np.max(np.abs(np.angle(values / real)))))
    return turned * _sense(one, other)


def _sense(one: np.ndarray, other: np.ndarray) -> float:
    """Which way corners go round in the picture: +1 counter-clockwise, as a person sees it."""
    slope, *_ = np.linalg.lstsq(np.column_stack([one, np.ones(len(one))]), other - one, rcond=None)
    # Rows of pictures count downwards.
    return 1.0 if slope[1, 0] - slope[0, 1] > 0.0 else -1.0


def _turn_of_board(spec: BoardSpec, before: Corners, after: Corners, camera: CameraIntrinsics) -> float:
    """The board is a rigid thing of known size: its pose in both pictures."""
    points = spec.points()
    rotations = []
    for seen in (before, after):
        if len(seen) < _FEWEST_CORNERS:
            return float("nan")
        numbers = sorted(seen)
        corners = np.concatenate([seen[number] for number in numbers])
        rotations.append(board_pose(camera, corners, points[numbers]).camera_from_board.rotation)
    turn, _ = cv2.Rodrigues(rotations[1] @ rotations[0].T)
    # The camera's y points down, the table's axis up.
    return float(np.degrees(np.linalg.norm(turn))) * (1.0 if turn[1, 0] < 0.0 else -1.0)
