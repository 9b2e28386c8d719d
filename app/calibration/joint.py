"""One adjustment over everything that was recorded, and what it says about the rig and about itself."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from app.calibration.error_budget import expected_error_mm
from app.calibration.platter import marker_points
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
from app.recording.shot import Role

_SCALE_TOLERATED = 0.002


@dataclass(frozen=True, eq=False, slots=True)
class ViewResidual:
    """How one view fits.

    Attributes:
        name: the frame.
        role: what it was taken for.
        corner_px: RMS of its reprojected corners; NaN where it shows none.
        stripe_px: RMS of each laser's stripe points to the laser plane, across the stripe.
        angle_deg: table angle that was solved for, counter-clockwise; NaN for a free view.
        commanded_deg: as the recording has it, counter-clockwise; NaN where unknown.
    """

    name: str
    role: Role
    corner_px: float
    stripe_px: Mapping[str, float]
    angle_deg: float
    commanded_deg: float

    @property
    def angle_error_deg(self) -> float:
        """Solved minus commanded, -180..180."""
        return (self.angle_deg - self.commanded_deg + 180.0) % 360.0 - 180.0


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
    problem = pose_problem(evidence, camera, columns, excluded)
    if not problem.lasers and not problem.has_axis:
        raise CalibrationError(
            "The recordings show the board, but neither a laser on it nor a table that turns.",
            "Record laser_plane views and axis views or markers on the table as well.",
        )
    solution = solve(problem.state, problem.corners, problem.stripes, problem.free, on_step)
    return _read(problem, solution)


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
        {name: _plane_rms(problem, solution, row) for row, name in enumerate(problem.lasers)},
        _rms(solution.corner_residuals[on_axis]) * float(depth / state.camera[0]) if on_axis.any() else 0.0,
        noise,
        solution.chi,
        expected_error_mm(rig, solution, len(problem.lasers))
        if problem.has_axis and lasers
        else float("nan"),
        layout,
        state.marker_mm,
        _view_residuals(problem, solution),
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


def _plane_rms(problem: Problem, solution: Solution, laser: int) -> float:
    """Distance of the stripe points on boards to their plane, mm."""
    state, stripes = solution.state, problem.stripes
    mine = (stripes.laser == laser) & (stripes.group < 2 + len(problem.lasers))
    rays = camera_from_vector(state.camera, state.size).rays(stripes.pixels[mine])
    angles = np.append(state.angles, 0.0)[stripes.angle[mine]]
    table = np.array([rotation_about(state.axis_direction, a) for a in angles]).reshape(-1, 3, 3)
    body = stripes.body[mine]
    normal = np.einsum("nij,nj->ni", table, state.rotations[body][:, :, 2])
    point = np.einsum("nij,nj->ni", table, state.translations[body] - state.axis_point) + state.axis_point
    depth = np.einsum("ni,ni->n", normal, point) / np.einsum("ni,ni->n", normal, rays)
    plane = state.planes[laser]
    off = (rays * depth[:, None]) @ plane[:3] - plane[3]
    kept = np.abs(off) < 6.0 * 1.4826 * float(np.median(np.abs(off)))
    return _rms(off[kept])


def _view_residuals(problem: Problem, solution: Solution) -> tuple[ViewResidual, ...]:
    out = []
    for number, view in enumerate(problem.views):
        corners = solution.corner_residuals[problem.corner_view == number]
        stripes = {}
        for row, laser in enumerate(problem.lasers):
            mine = (problem.stripe_view == number) & (problem.stripes.laser == row)
            if mine.any():
                stripes[laser] = _rms(solution.stripe_residuals[mine])
        angle = problem.view_angle[number]
        solved = float(np.degrees(solution.state.angles[angle])) if angle >= 0 else float("nan")
        out.append(
            ViewResidual(
                view.name,
                view.role,
                _rms(corners) if len(corners) else float("nan"),
                stripes,
                solved,
                float(np.degrees(view.angle_rad)),
            )
        )
    return tuple(out)
