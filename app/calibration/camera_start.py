"""The camera that the rest of a calibration starts from."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from app.calibration.intrinsics import IntrinsicsResult, solve_intrinsics
from app.calibration.plan import CalibrationPlan
from app.calibration.views import Evidence, View
from app.errors import CalibrationError
from app.geometry.camera import CameraIntrinsics
from app.recording.shot import Role

_ENOUGH_CAMERA_VIEWS = 6
_FOCUS_SIGMAS = 3.0
_FOCUS_SHARE = 0.004


@dataclass(frozen=True, eq=False, slots=True)
class StartCamera:
    """The camera to start from, and what is known of it.

    Attributes:
        camera: the camera.
        result: how it was solved for; None where it was given.
        refine: whether the other views may change it.
        excluded: names of views that do not belong.
        dropped: the same, and why.
        notes: what the person should know.
    """

    camera: CameraIntrinsics
    result: IntrinsicsResult | None
    refine: bool
    excluded: frozenset[str]
    dropped: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]

    @property
    def rms_px(self) -> float:
        """Reprojection residual; NaN for a camera that was given."""
        return self.result.rms_px if self.result is not None else float("nan")

    @property
    def doubts(self) -> tuple[str, ...]:
        return self.result.warnings if self.result is not None else ()


def start_camera(evidence: Evidence, plan: CalibrationPlan) -> StartCamera:
    """The camera that was given, or one solved from its own views, or else from all views of the board.

    Raises:
        CalibrationError: the board was never seen, or a given camera is for pictures of another size.
    """
    if plan.camera is not None:
        if plan.camera.size != evidence.size:
            raise CalibrationError(
                "The camera that was given is for pictures of {}x{}, the recording's are {}x{}.".format(
                    *plan.camera.size, *evidence.size
                ),
                "Calibrate the camera at the picture size of the recording.",
            )
        return StartCamera(plan.camera, None, False, frozenset(), (), ())
    boards = [view for view in evidence.views if view.board.is_found]
    own = [view for view in boards if view.role is Role.INTRINSICS]
    others = [view for view in boards if view.role is not Role.INTRINSICS]
    used = own if len(own) >= _ENOUGH_CAMERA_VIEWS else boards
    if not used:
        raise CalibrationError(
            "The board was never seen, so the camera is unknown.",
            "Check the board's kind, columns and rows in recording.json, or give a known camera "
            "with --intrinsics.",
        )
    result = _intrinsics(used, evidence, plan)
    notes: list[str] = []
    refine = True
    if used is own and len(others) >= _ENOUGH_CAMERA_VIEWS:
        focus = _focus_change(result, others, evidence)
        if focus:
            notes.append(focus)
            refine = False
    names = [used[view.index].name for view in result.dropped]
    dropped = tuple((used[view.index].name, view.reason) for view in result.dropped)
    camera = result.camera
    if not plan.uses_distortion:
        camera = CameraIntrinsics(camera.matrix, np.zeros(5), camera.size)
    return StartCamera(camera, result, refine, frozenset(names), dropped, tuple(notes))


def _intrinsics(views: Sequence[View], evidence: Evidence, plan: CalibrationPlan) -> IntrinsicsResult:
    board = evidence.board
    sought = "board" if board is None else f"{board.columns} x {board.rows} {board.kind}"
    model: Literal["paper", "full"] = "paper" if plan.method == "paper" else "full"
    return solve_intrinsics([v.board for v in views], evidence.size, model=model, sought=sought)


def _focus_change(result: IntrinsicsResult, others: Sequence[View], evidence: Evidence) -> str:
    """A sentence where the other views contradict the camera; empty where they agree or cannot tell."""
    try:
        second = solve_intrinsics([v.board for v in others], evidence.size, model="paper")
    except CalibrationError:
        return ""
    first_px, second_px = result.camera.matrix[0, 0], second.camera.matrix[0, 0]
    sigma = float(np.hypot(result.standard_deviations[0], second.standard_deviations[0]))
    is_other = abs(first_px - second_px) > max(_FOCUS_SIGMAS * sigma, _FOCUS_SHARE * first_px)
    if second.warnings or not is_other:
        return ""
    return (
        f"The camera changed its focus: fx is {first_px:.1f} px in the camera views and {second_px:.1f} px "
        "in the laser and axis views. The camera views were trusted; switch autofocus off and record again "
        "for a better result."
    )
