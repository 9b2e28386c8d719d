"""One adjustment over everything that was recorded, and what it says about the rig and about itself."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from app.calibration.bundle import State
from app.calibration.error_budget import expected_error_mm
from app.calibration.outcome import ViewResidual
from app.calibration.platter import marker_points
from app.calibration.platter_file import platter_entry
from app.calibration.problem import Problem, pose_problem
from app.calibration.projection import camera_from_vector
from app.calibration.solver import Solution, solve
from app.calibration.views import Evidence
from app.errors import CalibrationError
from app.geometry.arrays import Floats, Points
from app.geometry.axis import TurntableAxis
from app.geometry.camera import CameraIntrinsics
from app.geometry.plane import LaserPlane
from app.geometry.rig import Rig
from app.geometry.transform import RigidTransform, rotation_about
from app.vision.markers import MarkerObservation

# Blur draws the corners of a marker inwards by about a hundredth of its side.
_SCALE_TOLERATED = 0.015


@dataclass(frozen=True, eq=False, slots=True)
class JointResult:
    """A calibrated rig with its uncertainty.

    Attributes:
        rig: camera, laser planes and axis.
        has_axis: whether anything turned, so that the axis means something.
        camera_sigma: standard deviation of each of the camera's nine numbers; zero where held fixed.
        rms_px: of the reprojected corners of boards.
        plane_rms_mm: of each laser's stripe points to its plane.
        axis_rms_mm: RMS by which seen corners of turning bodies miss their circles.
        noise_px: noise seen in each group of observations.
        chi: RMS of residuals over assumed noise; near one where the model and the noise are right.
        expected_error_mm: one sigma of a surface point at the object that calibration alone causes.
        layout: (4, 3) corners of each marker in the table frame at angle zero.
        marker_mm: side of the markers, solved for where the stripe crosses them.
        views: how each view fits.
        corner_pixels, corner_residuals: (N, 2) of all corners of boards, for plots.
        dropped: views left out, and why.
        warnings: plain sentences.
    """

    rig: Rig
    has_axis: bool
    camera_sigma: Floats
    rms_px: float
    plane_rms_mm: Mapping[str, float]
    axis_rms_mm: float
    noise_px: Mapping[str, float]
    chi: float
    expected_error_mm: float
    layout: Mapping[int, Points]
    marker_mm: float
    views: tuple[ViewResidual, ...]
    corner_pixels: Floats
    corner_residuals: Floats
    dropped: tuple[tuple[str, str], ...]
    warnings: tuple[str, ...]


def solve_joint(
    evidence: Evidence,
    camera: CameraIntrinsics,
    *,
    refine_camera: bool,
    excluded: frozenset[str] = frozenset(),
    on_step: Callable[[int, float], None] = lambda step, cost: None,
) -> JointResult:
    """Bundle adjustment of camera, laser planes, axis, boards, markers and every table angle.

    Args:
        evidence: everything that was seen.
        camera: start value of the camera, or its value where it is not refined.
        refine_camera: whether the camera's numbers may change; a k3 of zero stays zero.
        excluded: names of board views to leave out.
        on_step: told the number of the step and the cost.

    Raises:
        CalibrationError: the views do not determine the rig.
    """
    columns: list[int] = []
    if refine_camera:
        columns = list(range(9 if camera.distortion[4] != 0.0 else 8))
    has_markers = any(len(view.markers.ids) for view in evidence.views)
    if columns and has_markers:
        # Corners of markers carry errors of print and edge that repeat in every view of the table; hundreds
        # of them would bend the camera, so it is found from the boards and then held.
        camera = _camera_from_boards(evidence, camera, columns, excluded, on_step)
    problem = pose_problem(evidence, camera, [] if has_markers else columns, excluded)
    if not problem.lasers and not problem.has_axis:
        raise CalibrationError(
            "The recordings show the board, but neither a laser on it nor a table that turns.",
            "Record laser_plane views and axis views or markers on the table as well.",
        )
    uncertain = np.union1d(problem.free, np.array(columns, np.intp))
    solution = solve(problem.state, problem.corners, problem.stripes, problem.free, on_step, uncertain)
    return _read(problem, solution)


def _camera_from_boards(
    evidence: Evidence,
    camera: CameraIntrinsics,
    columns: list[int],
    excluded: frozenset[str],
    on_step: Callable[[int, float], None],
) -> CameraIntrinsics:
    unseen = MarkerObservation(np.zeros(0, np.intp), np.zeros((0, 4, 2)))
    views = tuple(replace(view, markers=unseen) for view in evidence.views)
    if not any(view.board.is_found for view in views):
        return camera
    problem = pose_problem(replace(evidence, views=views, platter=None), camera, columns, excluded)
    state = solve(problem.state, problem.corners, problem.stripes, problem.free, on_step).state
    return camera_from_vector(state.camera, state.size)


def _read(problem: Problem, solution: Solution) -> JointResult:
    state = solution.state
    axis = TurntableAxis(state.axis_point, state.axis_direction)
    layout: dict[int, Points] = {}
    if problem.sheet >= 0:
        sheet = RigidTransform(state.rotations[problem.sheet], state.translations[problem.sheet])
        axis = _with_table(axis, sheet)
        corners = marker_points(state.layout, state.marker_mm)
        table_from_sheet = axis.camera_from_table.inverse() @ sheet
        layout = {i: table_from_sheet @ c for i, c in zip(problem.marker_ids, corners, strict=True)}
    lasers = {
        name: LaserPlane.through(plane[:3] * plane[3], plane[:3])
        for name, plane in zip(problem.lasers, state.planes, strict=True)
    }
    rig = Rig(camera_from_vector(state.camera, state.size), lasers, axis)
    is_board = problem.corners.group == 0
    on_axis = problem.corners.angle >= 0
    off_mm = _off_plane_mm(problem, state)
    on_board = problem.stripes.group < 2 + len(problem.lasers)
    depth = np.linalg.norm(state.axis_point)
    marker_mm = problem.state.marker_mm
    warnings = list(problem.warnings)
    noise = {
        name: float(solution.noise[k]) * _assumed_px(problem, k)
        for k, name in enumerate(problem.groups)
        if _assumed_px(problem, k) > 0.0
    }
    if abs(state.marker_mm / marker_mm - 1.0) > _SCALE_TOLERATED:
        warnings.append(
            f"The markers on the table measure {state.marker_mm:.2f} mm, not the {marker_mm:g} mm that the "
            "recording states: they were printed at another scale. The measured size was used."
        )
    return JointResult(
        rig,
        problem.has_axis,
        np.sqrt(np.diag(solution.covariance_of(np.arange(9)))),
        _rms(solution.corner_residuals[is_board]) if is_board.any() else float("nan"),
        {name: _core_rms(off_mm[on_board & (problem.stripes.laser == k)]) for k, name in enumerate(lasers)},
        _rms(solution.corner_residuals[on_axis]) * float(depth / state.camera[0]) if on_axis.any() else 0.0,
        noise,
        solution.chi,
        expected_error_mm(rig, solution, len(problem.lasers))
        if problem.has_axis and lasers
        else float("nan"),
        layout,
        state.marker_mm,
        _view_residuals(problem, solution, off_mm),
        problem.corners.pixels[is_board],
        solution.corner_residuals[is_board],
        problem.dropped,
        tuple(warnings),
    )


def _with_table(axis: TurntableAxis, sheet: RigidTransform) -> TurntableAxis:
    """The axis with the table's plane where the sheet of markers cuts it."""
    normal = sheet.rotation[:, 2]
    offset = float(normal @ (sheet.translation - axis.point_mm)) / float(normal @ axis.direction)
    return TurntableAxis(axis.point_mm, axis.direction, offset)


def _rms(residuals: Floats) -> float:
    """RMS length of (N, 2) vectors or RMS of (N,) numbers."""
    return float(np.sqrt(np.sum(residuals**2) / max(len(residuals), 1)))


def _assumed_px(problem: Problem, group: int) -> float:
    """RMS noise that was assumed in a group; zero where it is empty."""
    corners, stripes = problem.corners, problem.stripes
    sigma = np.concatenate([corners.sigma[corners.group == group], stripes.sigma[stripes.group == group]])
    return float(np.sqrt(np.mean(sigma**2))) if len(sigma) else 0.0


def _off_plane_mm(problem: Problem, state: State) -> Floats:
    """Distance of every stripe point, on the body that it falls on, to its laser plane: (Ns,) mm."""
    stripes = problem.stripes
    rays = camera_from_vector(state.camera, state.size).rays(stripes.pixels)
    turns = np.array([rotation_about(state.axis_direction, a) for a in state.angles] + [np.eye(3)])
    turn = turns[stripes.angle]
    normal = np.einsum("nij,nj->ni", turn, state.rotations[stripes.body][:, :, 2])
    arm = np.einsum("nij,nj->ni", turn, state.translations[stripes.body] - state.axis_point)
    depth = np.einsum("ni,ni->n", normal, arm + state.axis_point) / np.einsum("ni,ni->n", normal, rays)
    plane = state.planes[stripes.laser]
    off: Floats = np.einsum("ni,ni->n", rays * depth[:, None], plane[:, :3]) - plane[:, 3]
    return off


def _core_rms(off: Floats) -> float:
    """RMS without what the robust loss sets aside."""
    if len(off) == 0:
        return float("nan")
    return _rms(off[np.abs(off) < 6.0 * 1.4826 * float(np.median(np.abs(off))) + 1e-12])


def _view_residuals(problem: Problem, solution: Solution, off_mm: Floats) -> tuple[ViewResidual, ...]:
    out = []
    for number, view in enumerate(problem.views):
        corners = solution.corner_residuals[problem.corner_view == number]
        stripes_px, stripes_mm = {}, {}
        for row, laser in enumerate(problem.lasers):
            mine = (problem.stripe_view == number) & (problem.stripes.laser == row)
            if mine.any():
                stripes_px[laser] = _rms(solution.stripe_residuals[mine])
                stripes_mm[laser] = _rms(off_mm[mine])
        angle = problem.view_angle[number]
        solved = float(np.degrees(solution.state.angles[angle])) if angle >= 0 else float("nan")
        out.append(
            ViewResidual(
                view.name,
                view.role,
                _rms(corners) if len(corners) else float("nan"),
                stripes_px,
                stripes_mm,
                solved,
                float(np.degrees(view.angle_rad)),
            )
        )
    return tuple(out)


def joint_extra(found: JointResult) -> dict[str, Any]:
    """What the calibration file keeps of it beside the rig."""
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
