"""Calibration step by step, as in Rui Wang's paper: camera, laser planes by SVD, axis."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from app.calibration.board_views import BoardView, board_views
from app.calibration.camera_start import StartCamera
from app.calibration.joint import joint_extra, solve_joint
from app.calibration.laser_plane import LaserPlaneResult, solve_laser_plane
from app.calibration.outcome import CalibrationOutcome, ViewResidual
from app.calibration.plan import CalibrationPlan
from app.calibration.record import CalibrationRecord
from app.calibration.turntable_axis import AxisResult, solve_axis_line, solve_axis_turning
from app.calibration.views import Evidence
from app.errors import CalibrationError
from app.geometry.arrays import Points
from app.geometry.camera import CameraIntrinsics
from app.recording.shot import Role
from app.vision.board import BoardObservation

_NO_BOARD = BoardObservation.empty()


def paper_outcome(evidence: Evidence, camera: StartCamera, plan: CalibrationPlan) -> CalibrationOutcome:
    """Camera, laser planes and axis, each by itself and from its own views.

    Raises:
        CalibrationError: the views do not show what the axis method needs.
    """
    boards, bad = board_views(evidence, camera.camera, camera.excluded)
    planes = {}
    for laser in evidence.lasers:
        poses = [
            b.points(camera.camera, laser)
            for b in boards
            if laser in b.stripes and b.view.role is not Role.AXIS_LINE
        ]
        if len(poses) >= 2:
            planes[laser] = solve_laser_plane(laser, poses)
    axis, axis_method, layout_extra = _paper_axis(evidence, camera.camera, boards, plan)
    doubts = list(camera.doubts)
    doubts += [text for plane in planes.values() for text in plane.warnings]
    notes = [*camera.notes]
    if axis is None:
        notes.append("No axis: no view shows the laser along the axis, nor a board or markers that turn.")
    else:
        notes += axis.warnings
    record = CalibrationRecord(
        camera=camera.camera,
        lasers={laser: found.plane for laser, found in planes.items()},
        axis=None if axis is None else axis.axis,
        rms_px=camera.rms_px,
        laser_rms_mm={laser: found.rms_mm for laser, found in planes.items()},
        axis_rms_mm=float("nan") if axis is None else axis.rms_mm,
        method="paper",
        extra=layout_extra,
    )
    fitted = camera.result.views if camera.result is not None else ()
    return CalibrationOutcome(
        record,
        camera.result.standard_deviations if camera.result is not None else np.zeros(9),
        evidence.coverage(),
        np.concatenate([np.zeros((0, 2)), *(view.corners for view in fitted)]),
        np.concatenate([np.zeros((0, 2)), *(view.residuals for view in fitted)]),
        tuple(_paper_view(b, camera.camera, planes) for b in boards),
        {},
        float("nan"),
        axis_method,
        camera.dropped + tuple(bad) + evidence.skipped,
        tuple(notes),
        tuple(doubts),
    )


def _paper_view(
    seen: BoardView, camera: CameraIntrinsics, planes: dict[str, LaserPlaneResult]
) -> ViewResidual:
    off_mm = {}
    for laser, found in planes.items():
        if laser in seen.stripes:
            distance = found.plane.signed_distance(seen.points(camera, laser))
            off_mm[laser] = float(np.sqrt(np.mean(distance**2)))
    commanded = float(np.degrees(seen.view.angle_rad))
    return ViewResidual(seen.view.name, seen.view.role, seen.pose.rms_px, {}, off_mm, float("nan"), commanded)


def _paper_axis(
    evidence: Evidence, camera: CameraIntrinsics, boards: Sequence[BoardView], plan: CalibrationPlan
) -> tuple[AxisResult | None, str, dict[str, Any]]:
    """The axis, how it was found, and what else to keep of it."""
    lines = [b for b in boards if b.view.role is Role.AXIS_LINE]
    turning = [b for b in boards if b.view.role is Role.AXIS]
    has_markers = any(len(view.markers.ids) for view in evidence.views)
    wanted = plan.axis
    if wanted == "auto":
        wanted = "line" if lines else "board" if turning else "platter"
    if wanted == "line":
        if not lines and plan.axis == "auto":
            return None, "", {}
        points: list[Points] = [b.points(camera, laser) for b in lines for laser in b.stripes]
        return solve_axis_line(np.concatenate([np.zeros((0, 3)), *points])), "line", {}
    if wanted == "board":
        placements: dict[str, list[BoardView]] = {}
        for b in turning:
            placements.setdefault(b.view.placement, []).append(b)
        found = solve_axis_turning(
            [[b.pose.camera_from_board for b in group] for group in placements.values()],
            [np.array([b.view.angle_rad for b in group]) for group in placements.values()],
        )
        return found, "board", {}
    if not has_markers:
        if plan.axis == "auto":
            return None, "", {}
        raise CalibrationError(
            "No markers were seen on the table, so the axis cannot be found from them.",
            "Choose --axis board or line, or put the printed markers on the table.",
        )
    marked = tuple(
        replace(view, board=_NO_BOARD, stripes={})
        for view in evidence.views
        if view.is_on_table and len(view.markers.ids)
    )
    joint = solve_joint(replace(evidence, views=marked), camera, refine_camera=False)
    view_mm = np.array([v.corner_px for v in joint.views]) * joint.axis_rms_mm
    return (
        AxisResult(joint.rig.axis, joint.axis_rms_mm, view_mm, joint.warnings),
        "platter",
        joint_extra(joint),
    )
