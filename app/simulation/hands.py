"""A pair of hands that holds the calibration board before the camera: a moment of rest, then another pose."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from app.geometry.rig import Rig
from app.geometry.transform import RigidTransform, rotation_from_rvec
from app.simulation.boards import board_plate
from app.simulation.poses import free_poses, sheet_poses
from app.vision.board import BoardSpec

_POSES = 20


@dataclass(frozen=True, eq=False, slots=True)
class Hands:
    """Where the board is at any time.

    Attributes:
        poses: camera from board, one after the other and from the start again.
        rest_s: how long each is held.
        move_s: how long it takes to the next.
    """

    poses: tuple[RigidTransform, ...]
    rest_s: float = 0.7
    move_s: float = 0.6

    @classmethod
    def of(cls, rig: Rig, board: BoardSpec, *, across_lasers: bool, seed: int) -> Self:
        """Hands that show the board all over the picture, or where every laser's sheet crosses it."""
        rng, plate = np.random.default_rng([seed, across_lasers]), board_plate(board)
        if across_lasers:
            return cls(tuple(sheet_poses(rig, plate, _POSES, rng)))
        return cls(tuple(free_poses(rig.camera, plate, _POSES, rng)))

    def pose_at(self, time_s: float) -> RigidTransform:
        """Camera from board, so long after the hands took it."""
        number, within_s = divmod(max(time_s, 0.0), self.rest_s + self.move_s)
        here = self.poses[int(number) % len(self.poses)]
        if within_s <= self.rest_s:
            return here
        return _between(
            here, self.poses[int(number + 1) % len(self.poses)], (within_s - self.rest_s) / self.move_s
        )


def _between(here: RigidTransform, there: RigidTransform, share: float) -> RigidTransform:
    """On the way, with the speed of a hand: least jerk (Flash and Hogan 1985)."""
    done = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    turn = RigidTransform(there.rotation @ here.rotation.T, np.zeros(3)).rvec
    return RigidTransform(
        rotation_from_rvec(done * turn) @ here.rotation,
        here.translation + done * (there.translation - here.translation),
    )
