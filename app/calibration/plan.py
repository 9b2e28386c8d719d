"""How to calibrate."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

from app.geometry.camera import CameraIntrinsics

Method: TypeAlias = Literal["joint", "paper"]
AxisMethod: TypeAlias = Literal["auto", "line", "board", "platter"]


@dataclass(frozen=True, slots=True)
class CalibrationPlan:
    """How to calibrate.

    Attributes:
        method: `joint`, or `paper` (each part by itself, as in Rui Wang's paper).
        axis: for the paper's method: `line` along a board through the axis, `board` that turns, `platter`
            markers; `auto` takes the first of them that was recorded.
        camera: known camera, which is then not solved for.
        uses_distortion: the paper computes the distortion and then leaves it out; so does `False`.
        skips_bad_frames: a picture that cannot be read is left out and reported instead of ending the run.
    """

    method: Method = "joint"
    axis: AxisMethod = "auto"
    camera: CameraIntrinsics | None = None
    uses_distortion: bool = True
    skips_bad_frames: bool = False
