"""From recordings to a calibrated rig: gather what was seen, solve by the method asked for, judge it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias

import numpy as np

from app.calibration.coverage import Coverage
from app.calibration.intrinsics import IntrinsicsResult, solve_intrinsics
from app.calibration.joint import JointResult, solve_joint
from app.calibration.laser_plane import LaserPlaneResult, solve_laser_plane
from app.calibration.outcome import CalibrationOutcome, ViewResidual
from app.calibration.platter_file import platter_entry
from app.calibration.problem import BoardView, board_views
from app.calibration.record import CalibrationRecord
from app.calibration.turntable_axis import AxisResult, solve_axis_line, solve_axis_turning
from app.calibration.views import Evidence, View, gather
from app.errors import CalibrationError
from app.geometry.arrays import Points
from app.geometry.camera import CameraIntrinsics
from app.recording.reader import Recording
from app.recording.shot import Role
from app.vision.board import BoardObservation
from app.vision.stripe import StripeDetector

Method: TypeAlias = Literal["joint", "paper"]
AxisMethod: TypeAlias = Literal["auto", "line", "board", "platter"]

_ENOUGH_CAMERA_VIEWS = 6
_FOCUS_SIGMAS = 3.0
_FOCUS_SHARE = 0.004
_TOLERATED_MM = 0.5
_WOBBLE_MM = 1.0
_CHI_SUSPECT = 3.0
_NO_BOARD = BoardObservation(np.zeros(0, np.intp), np.zeros((0, 2)), np.zeros((0, 3)))


@dataclass(frozen=True, slots=True)
class CalibrationPlan:
    """How to calibrate.

    Attributes:
        method: `joint`, or `paper` (each part by itself, as in Rui Wang's paper).
        axis: for the paper's method: `line` along a board through the axis, `board` that turns, `platter`
            markers; `auto` takes the first of them that was recorded.
        camera: known camera, which is then not solved for.
        uses_distortion: the paper computes the distortion and then leaves it out; so does `False`.
    """

    method: Method = "joint"
    axis: AxisMethod = "auto"
    camera: CameraIntrinsics | None = None
    uses_distortion: bool = True


def calibrate(
    recordings: Sequence[Recording],
    detector: StripeDetector,
    plan: CalibrationPlan,
    on_progress: Callable[[str, int, int | None], None] = lambda stage, done, total: None,
) -> CalibrationOutcome:
    """Calibrate from recordings of one rig.

    Args:
        recordings: frames of any calibration role; scan frames help where markers lie on the table.
        detector: finds the stripes.
        on_progress: told the stage, how much of it is done and, where known, of how much.

    Raises:
        CalibrationError: the recordings do not give the calibration that was asked for.
    """
    evidence = gather(
        recordings, detector, lambda done, total: on_progress("Looking at pictures", done, total)
    )
    return calibrate_evidence(evidence, plan, on_progress)


def calibrate_evidence(
    evidence: Evidence,
    plan: CalibrationPlan,
    on_progress: Callable[[str, int, int | None], None] = lambda stage, done, total: None,
) -> CalibrationOutcome:
    """As `calibrate`, from what was seen."""
    unseen = [laser for laser in evidence.lasers if not any(laser in view.stripes for view in evidence.views)]
    expects_laser = any(view.role in (Role.LASER_PLANE, Role.AXIS) for view in evidence.views)
    if unseen and len(unseen) == len(evidence.lasers) and expects_laser:
        raise CalibrationError(
            f"The laser {unseen[0]!r} was not seen in any picture.",
            "Check the laser's colour in recording.json, darken the room or lower the exposure, "
            "and try another --detector.",
        )
    camera = _solve_camera(evidence, plan)
    if plan.method == "joint":
        outcome = _joint(evidence, camera, on_progress)
    else:
        outcome = _paper(evidence, camera, plan)
    missing = tuple(
        f"Laser {laser!r} has no plane: it was seen on the board in fewer than two poses."
        for laser in evidence.lasers
        if laser not in outcome.record.lasers
    )
    return replace(outcome, notes=outcome.notes + missing)


@dataclass(frozen=True, eq=False, slots=True)
class _Camera:
    """The camera to start from, and what is known of it."""

    camera: CameraIntrinsics
    result: IntrinsicsResult | None
    refine: bool
    excluded: frozenset[str]
    dropped: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]


def _solve_camera(evidence: Evidence, plan: CalibrationPlan) -> _Camera:
    if plan.camera is not None:
        if plan.camera.size != evidence.size:
            raise CalibrationError(
                "The camera that was given is for pictures of {}x{}, the recording's are {}x{}.".format(
                    *plan.camera.size, *evidence.size
                ),
                "Calibrate the camera at the picture size of the recording.",
            )
        return _Camera(plan.camera, None, False, frozenset(), (), ())
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
    return _Camera(camera, result, refine, frozenset(names), dropped, tuple(notes))


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


def _joint(
    evidence: Evidence, camera: _Camera, on_progress: Callable[[str, int, int | None], None]
) -> CalibrationOutcome:
    if not any(view.stripes or view.is_on_table for view in evidence.views):
        return _camera_only(evidence, camera)
    found = solve_joint(
        evidence,
        camera.camera,
        refine_camera=camera.refine,
        excluded=camera.excluded,
        on_step=lambda step, cost: on_progress("Adjusting everything together", step, None),
    )
    doubts = list(camera.result.warnings if camera.result is not None else ())
    if found.has_axis and found.expected_error_mm > _TOLERATED_MM:
        doubts.append(
            f"The views leave {found.expected_error_mm:.2f} mm of doubt at the object: add views of the "
            "board on the table in a second place, and at more angles."
        )
    if found.has_axis and found.rig.lasers and not np.isfinite(found.expected_error_mm):
        doubts.append(
            "No laser plane passes near the axis where the picture shows it, so an object on the table would "
            "not be measured: aim the laser at the axis, or take views that determine its plane better."
        )
    if found.axis_rms_mm > _WOBBLE_MM:
        doubts.append(
            f"The board or the markers miss their circles by {found.axis_rms_mm:.2f} mm: they moved on the "
            "table, the table wobbles, or the stated size is wrong."
        )
    notes = [*camera.notes, *found.warnings]
    if found.chi > _CHI_SUSPECT:
        notes.append(
            f"The residuals are {found.chi:.1f} times what good corners and stripes leave (chi): blurred or "
            "compressed pictures, a board that is not flat, or distortion that the model does not cover."
        )
    record = CalibrationRecord(
        camera=found.rig.camera,
        lasers=found.rig.lasers,
        axis=found.rig.axis if found.has_axis else None,
        rms_px=found.rms_px if np.isfinite(found.rms_px) else _rms_of(camera),
        laser_rms_mm=found.plane_rms_mm,
        axis_rms_mm=found.axis_rms_mm if found.has_axis else float("nan"),
        method="joint",
        expected_error_mm=found.expected_error_mm,
        extra=_extra(found),
    )
    if found.has_axis is False:
        notes.append("No axis: no board or marker was seen at two angles of the table.")
    return CalibrationOutcome(
        record,
        found.camera_sigma,
        _coverage(evidence),
        found.corner_pixels,
        found.corner_residuals,
        found.views,
        found.noise_px,
        found.chi,
        "joint" if found.has_axis else "",
        camera.dropped + found.dropped + evidence.skipped,
        tuple(notes),
        tuple(doubts),
    )


def _rms_of(camera: _Camera) -> float:
    return camera.result.rms_px if camera.result is not None else float("nan")


def _extra(found: JointResult) -> dict[str, Any]:
    extra: dict[str, Any] = {
        "chi": found.chi,
        "camera": {"sigma": found.camera_sigma.tolist()},
        "views": [
            {
                "file": view.name,
                "role": view.role.value,
                **({"corner_px": view.corner_px} if np.isfinite(view.corner_px) else {}),
                **({"stripe_px": dict(view.stripe_px)} if view.stripe_px else {}),
                **({"angle_deg": view.angle_deg} if np.isfinite(view.angle_deg) else {}),
            }
            for view in found.views
        ],
    }
    if found.layout:
        extra["platter"] = platter_entry(found.layout, found.marker_mm)
    return extra


def _camera_only(evidence: Evidence, camera: _Camera) -> CalibrationOutcome:
    result = camera.result
    if result is None:
        raise CalibrationError(
            "The recordings show neither a laser nor a table that turns, and the camera was given.",
            "Record laser_plane and axis views.",
        )
    return CalibrationOutcome(
        CalibrationRecord(camera=camera.camera, rms_px=result.rms_px, method="camera only"),
        result.standard_deviations,
        result.coverage,
        np.concatenate([view.corners for view in result.views]),
        np.concatenate([view.residuals for view in result.views]),
        (),
        {},
        float("nan"),
        "",
        camera.dropped + evidence.skipped,
        (*camera.notes, "Only the camera was calibrated: no view shows a laser or a table that turns."),
        result.warnings,
    )


def _paper(evidence: Evidence, camera: _Camera, plan: CalibrationPlan) -> CalibrationOutcome:
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
    doubts = list(camera.result.warnings if camera.result is not None else ())
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
        rms_px=_rms_of(camera),
        laser_rms_mm={laser: found.rms_mm for laser, found in planes.items()},
        axis_rms_mm=float("nan") if axis is None else axis.rms_mm,
        method="paper",
        extra=layout_extra,
    )
    fitted = camera.result.views if camera.result is not None else ()
    return CalibrationOutcome(
        record,
        camera.result.standard_deviations if camera.result is not None else np.zeros(9),
        _coverage(evidence),
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
    return AxisResult(joint.rig.axis, joint.axis_rms_mm, view_mm, joint.warnings), "platter", _extra(joint)


def _coverage(evidence: Evidence) -> Coverage:
    return Coverage.of([v.board.corners for v in evidence.views if v.board.is_found], evidence.size)
