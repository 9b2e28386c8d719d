"""From recordings to a calibrated rig: gather what was seen, solve by the method asked for, judge it."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from app.calibration.camera_start import StartCamera, start_camera
from app.calibration.joint import joint_extra, solve_joint
from app.calibration.outcome import CalibrationOutcome
from app.calibration.paper import paper_outcome
from app.calibration.plan import CalibrationPlan
from app.calibration.record import CalibrationRecord
from app.calibration.views import Evidence, gather
from app.errors import CalibrationError
from app.recording.reader import Recording
from app.recording.shot import Role
from app.vision.stripe import StripeDetector

_TOLERATED_MM = 0.5
_WOBBLE_MM = 1.0
_CHI_SUSPECT, _CHI_WRONG = 3.0, 12.0


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
        FrameError: a picture cannot be read.
    """
    evidence = gather(
        recordings,
        detector,
        lambda done, total: on_progress("Looking at pictures", done, total),
        skips_bad_frames=plan.skips_bad_frames,
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
    camera = start_camera(evidence, plan)
    if plan.method == "joint":
        outcome = _joint_outcome(evidence, camera, on_progress)
    else:
        outcome = paper_outcome(evidence, camera, plan)
    missing = tuple(
        f"Laser {laser!r} has no plane: it was seen on the board in fewer than two poses."
        for laser in evidence.lasers
        if laser not in outcome.record.lasers
    )
    return replace(outcome, notes=outcome.notes + missing)


def _joint_outcome(
    evidence: Evidence, camera: StartCamera, on_progress: Callable[[str, int, int | None], None]
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
    # Where only the table was looked at, only the table matters, and the expected error tells of that.
    is_about_table = found.has_axis and all(view.is_on_table for view in evidence.views)
    doubts = [] if is_about_table else list(camera.doubts)
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
        (doubts if found.chi > _CHI_WRONG else notes).append(
            f"The residuals are {found.chi:.1f} times what good corners and stripes leave (chi): blurred or "
            "compressed pictures, a board that is not flat, or distortion that the model does not cover."
        )
    record = CalibrationRecord(
        camera=found.rig.camera,
        lasers=found.rig.lasers,
        axis=found.rig.axis if found.has_axis else None,
        rms_px=found.rms_px if np.isfinite(found.rms_px) else camera.rms_px,
        laser_rms_mm=found.plane_rms_mm,
        axis_rms_mm=found.axis_rms_mm if found.has_axis else float("nan"),
        method="joint",
        expected_error_mm=found.expected_error_mm,
        extra=joint_extra(found),
    )
    if found.has_axis is False:
        notes.append("No axis: no board or marker was seen at two angles of the table.")
    return CalibrationOutcome(
        record,
        found.camera_sigma,
        evidence.coverage(),
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


def _camera_only(evidence: Evidence, camera: StartCamera) -> CalibrationOutcome:
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
