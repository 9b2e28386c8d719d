"""From views to the arrays of the bundle adjustment, with start values for every unknown."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.calibration.bare_table import on_bare_table
from app.calibration.board_views import BoardView, board_views
from app.calibration.bundle import Corners, State, Stripes
from app.calibration.freedom import free_columns
from app.calibration.laser_plane import solve_laser_plane
from app.calibration.parts import (
    CornerPart,
    StripePart,
    board_corners,
    joined_corners,
    joined_stripes,
    thinned,
)
from app.calibration.platter import UNIT_CORNERS, SheetStart, marker_points, start_sheet
from app.calibration.poses import points_on_board
from app.calibration.projection import vector_from_camera
from app.calibration.turntable_axis import solve_axis_turning
from app.calibration.views import Evidence, View
from app.errors import CalibrationError
from app.geometry.arrays import Floats, Points
from app.geometry.axis import TurntableAxis
from app.geometry.camera import CameraIntrinsics
from app.geometry.transform import RigidTransform, rotation_about, rvec_from_rotation
from app.recording.shot import Role
from app.vision.stripe import LaserStripe

Indices = NDArray[np.intp]

_STRIPE_POINTS = 120
# Around a marker, in sides from its centre, the stripe is taken to lie on the table.
_MARKER_CLEAR, _MARKER_SURROUND = 0.65, 1.3


@dataclass(frozen=True, eq=False, slots=True)
class Problem:
    """Everything the adjustment needs, and how to read its result.

    Attributes:
        state: start values.
        corners: seen corners of boards and markers.
        stripes: stripe points on boards and on the marker sheet.
        free: (F,) columns to solve for.
        lasers: names of the planes.
        marker_ids: names of the layout's rows.
        sheet: body of the marker sheet, -1 where there is none.
        views: the views that are used.
        view_angle: (V,) index of each view's table angle, -1 for a free view.
        corner_view: (Nc,) index of the view that each corner belongs to.
        stripe_view: (Ns,) the same for stripe points.
        groups: names of the noise groups.
        has_axis: whether anything turned.
        dropped: views left out, and why.
        warnings: plain sentences.
    """

    state: State
    corners: Corners
    stripes: Stripes
    free: Indices
    lasers: tuple[str, ...]
    marker_ids: tuple[int, ...]
    sheet: int
    views: tuple[View, ...]
    view_angle: Indices
    corner_view: Indices
    stripe_view: Indices
    groups: tuple[str, ...]
    has_axis: bool
    dropped: tuple[tuple[str, str], ...]
    warnings: tuple[str, ...]


def pose_problem(
    evidence: Evidence,
    camera: CameraIntrinsics,
    camera_columns: Sequence[int],
    excluded: frozenset[str] = frozenset(),
) -> Problem:
    """The adjustment over all that was seen.

    Args:
        evidence: the views.
        camera: start value, or the truth where `camera_columns` is empty.
        camera_columns: which of the camera's nine numbers may change.
        excluded: names of board views to leave out.

    Raises:
        CalibrationError: nothing can be solved for.
    """
    boards, dropped = board_views(evidence, camera, excluded)
    marked = [view for view in evidence.views if view.is_on_table and len(view.markers.ids)]
    if not boards and not marked:
        raise CalibrationError("The board was not seen in any picture.")
    builder = _Builder(camera, boards, marked, evidence)
    return builder.problem(camera_columns, tuple(dropped))


class _Builder:
    """Collects bodies, angles and observations; used once."""

    def __init__(
        self,
        camera: CameraIntrinsics,
        boards: Sequence[BoardView],
        marked: Sequence[View],
        evidence: Evidence,
    ) -> None:
        self.camera, self.boards, self.marked = camera, boards, marked
        self.marker_mm = evidence.platter.marker_mm if evidence.platter is not None else 1.0
        self.warnings: list[str] = []
        names: dict[str, View] = {b.view.name: b.view for b in boards} | {v.name: v for v in marked}
        self.views = list(names.values())
        self.view_number = {name: number for number, name in enumerate(names)}
        self.start: SheetStart | None = None
        if marked:
            self.start = start_sheet(camera, [v.markers for v in marked], self.marker_mm)
        self.lasers = tuple(
            laser
            for laser in evidence.lasers
            if sum(laser in b.stripes and b.view.role is not Role.AXIS_LINE for b in boards) >= 2
        )
        self.groups: list[str] = ["board corners", "marker corners"]
        self.groups += [f"stripe {laser} on boards" for laser in self.lasers]
        self.groups += [f"stripe {laser} on the table" for laser in self.lasers]
        self.placements: dict[str, list[BoardView]] = {}
        for board in boards:
            if board.view.role is Role.AXIS:
                self.placements.setdefault(board.view.placement, []).append(board)
        self.axis, self.has_axis = self._axis()
        self.view_angle = np.full(len(self.views), -1, np.intp)
        self.angles: list[float] = []
        self.bodies: list[RigidTransform] = []
        self.body_of: dict[str, int] = {}
        self.corner_parts: list[CornerPart] = []
        self.stripe_parts: list[StripePart] = []

    def _axis(self) -> tuple[TurntableAxis, bool]:
        groups = [[b.pose.camera_from_board for b in p] for p in self.placements.values()]
        angles = [np.array([b.view.angle_rad for b in p]) for p in self.placements.values()]
        up = None
        if self.start is not None:
            usable = [k for k, p in enumerate(self.start.poses) if p.rms_px < 10.0]
            groups.append([self.start.poses[k].camera_from_board for k in usable])
            angles.append(np.array([self.marked[k].angle_rad for k in usable]))
            up = np.mean([self.start.poses[k].camera_from_board.rotation[:, 2] for k in usable], axis=0)
        try:
            result = solve_axis_turning(groups, angles, up)
        except CalibrationError:
            return TurntableAxis(np.array([0.0, 0.0, 1.0]), np.array([0.0, -1.0, 0.0])), False
        self.warnings += result.warnings
        return result.axis, True

    def problem(self, camera_columns: Sequence[int], dropped: tuple[tuple[str, str], ...]) -> Problem:
        planes = self._planes()
        sheet = -1
        if self.start is not None and self.has_axis:
            sheet = 0
            self._add_sheet(self.start, planes)
        for board in self.boards:
            self._add_board(board)
        corners, corner_view = joined_corners(self.corner_parts)
        stripes, stripe_view = joined_stripes(self.stripe_parts)
        start = self.start if sheet >= 0 else None
        state = State(
            vector_from_camera(self.camera),
            self.camera.size,
            self.axis.point_mm,
            self.axis.direction,
            planes,
            np.array([b.rotation for b in self.bodies]).reshape(-1, 3, 3),
            np.array([b.translation for b in self.bodies]).reshape(-1, 3),
            np.array(self.angles),
            np.zeros((0, 3)) if start is None else start.layout,
            self.marker_mm,
        )
        on_table = int(np.count_nonzero(stripes.group >= 2 + len(self.lasers)))
        return Problem(
            state,
            corners,
            stripes,
            free_columns(state, corners, camera_columns, has_axis=self.has_axis, on_table=on_table),
            self.lasers,
            () if start is None else start.ids,
            sheet,
            tuple(self.views),
            self.view_angle,
            corner_view,
            stripe_view,
            tuple(self.groups),
            self.has_axis,
            dropped,
            tuple(self.warnings),
        )

    def _add_sheet(self, start: SheetStart, planes: Floats) -> None:
        """The markers as the first body, an angle for every stop that shows them, and the stripes on it."""
        poses = [found.camera_from_board for found in start.poses]
        reference = poses[int(np.argmin([found.rms_px for found in start.poses]))]
        turned = [self._turned(reference, pose) for pose in poses]
        zero = _common_zero(np.array([view.angle_rad for view in self.marked]), np.array(turned))
        self.bodies.append(self._at_zero(reference, zero))
        table_stripes = self._on_table(start, planes)
        for view, turn, found in zip(self.marked, turned, start.poses, strict=True):
            if not np.isfinite(found.rms_px):
                continue
            number = self.view_number[view.name]
            angle = self._angle_of(number, zero + turn)
            self.corner_parts.append(self._marker_corners(view, number, angle, start.ids))
            for laser, stripe in table_stripes.get(view.name, {}).items():
                self.stripe_parts.append(self._stripe(stripe, number, 0, angle, laser, 1))

    def _add_board(self, board: BoardView) -> None:
        """One view of the board: a body of its own where it is held freely, else that of its placement."""
        number = self.view_number[board.view.name]
        pose = board.pose.camera_from_board
        body, angle = len(self.bodies), -1
        if board.view.role is Role.AXIS and self.has_axis:
            first = self.placements[board.view.placement][0]
            if board is first:
                commanded = board.view.angle_rad
                angle = self._angle_of(number, 0.0 if np.isnan(commanded) else commanded)
                self.body_of[board.view.placement] = body
                self.bodies.append(self._at_zero(pose, self.angles[angle]))
            else:
                body = self.body_of[board.view.placement]
                zero = self.angles[self.view_angle[self.view_number[first.view.name]]]
                angle = self._angle_of(number, zero + self._turned(first.pose.camera_from_board, pose))
        else:
            self.bodies.append(pose)
        self.corner_parts.append(board_corners(board.view, number, body, angle))
        for laser in self.lasers:
            # In the paper's axis pictures the laser may have been moved to run along the axis.
            if laser in board.stripes and board.view.role is not Role.AXIS_LINE:
                self.stripe_parts.append(self._stripe(board.stripes[laser], number, body, angle, laser, 0))

    def _angle_of(self, view: int, start_rad: float) -> int:
        """Index of the table angle of a view; a new one with that start value where it has none yet."""
        if self.view_angle[view] < 0:
            self.view_angle[view] = len(self.angles)
            self.angles.append(start_rad)
        return int(self.view_angle[view])

    def _turned(self, first: RigidTransform, second: RigidTransform) -> float:
        turn = rvec_from_rotation(second.rotation @ first.rotation.T)
        return float(turn @ self.axis.direction)

    def _at_zero(self, pose: RigidTransform, angle: float) -> RigidTransform:
        back = rotation_about(self.axis.direction, -angle)
        point = self.axis.point_mm
        return RigidTransform(back @ pose.rotation, back @ (pose.translation - point) + point)

    def _planes(self) -> Floats:
        planes = np.zeros((len(self.lasers), 4))
        for row, laser in enumerate(self.lasers):
            poses = [
                b.points(self.camera, laser)
                for b in self.boards
                if laser in b.stripes and b.view.role is not Role.AXIS_LINE
            ]
            found = solve_laser_plane(laser, poses)
            self.warnings += found.warnings
            planes[row] = [*found.plane.normal, found.plane.distance_mm]
        return planes

    def _on_table(self, start: SheetStart, planes: Floats) -> dict[str, dict[str, LaserStripe]]:
        """The stripes on the sheet of markers, by view and laser."""
        on_table: dict[str, dict[str, LaserStripe]] = {}
        for laser, plane in zip(self.lasers, planes, strict=True):
            stripes: dict[str, LaserStripe] = {}
            near: list[Points] = [np.zeros((0, 3))]
            for view, pose in zip(self.marked, start.poses, strict=True):
                if laser in view.stripes and np.isfinite(pose.rms_px):
                    sheet, stripe = pose.camera_from_board, view.stripes[laser]
                    points = points_on_board(self.camera, sheet, stripe.pixels)
                    is_near = self._near_markers(start, sheet, points)
                    stripes[view.name] = stripe.select(is_near)
                    near.append(points[is_near])
            lies = on_bare_table(
                np.concatenate(near), plane[:3], float(plane[3]), float(self.camera.matrix[0, 0])
            )
            ends = np.cumsum([len(stripe) for stripe in stripes.values()])
            for (name, stripe), mask in zip(stripes.items(), np.split(lies, ends)[:-1], strict=True):
                if mask.any():
                    on_table.setdefault(name, {})[laser] = stripe.select(mask)
        return on_table

    def _near_markers(self, start: SheetStart, pose: RigidTransform, points: Points) -> NDArray[np.bool_]:
        """Which points (N, 3) of the sheet's plane, camera frame, are near a marker."""
        on_sheet = (pose.inverse() @ points)[:, :2]
        centres = marker_points(start.layout, self.marker_mm).mean(axis=1)[:, :2]
        distance = np.abs(on_sheet[:, None] - centres[None]).max(axis=2).min(axis=1)
        near: NDArray[np.bool_] = (distance > _MARKER_CLEAR * self.marker_mm) & (
            distance < _MARKER_SURROUND * self.marker_mm
        )
        return near

    def _marker_corners(self, view: View, number: int, angle: int, ids: tuple[int, ...]) -> "CornerPart":
        known = [k for k, i in enumerate(view.markers.ids) if int(i) in ids]
        row = np.array([ids.index(int(view.markers.ids[k])) for k in known], np.intp)
        return CornerPart(
            view.markers.corners[known].reshape(-1, 2),
            np.tile(UNIT_CORNERS, (len(known), 1)),
            np.repeat(row, 4),
            0,
            angle,
            number,
            1,
        )

    def _stripe(
        self, stripe: LaserStripe, number: int, body: int, angle: int, laser: str, kind: int
    ) -> "StripePart":
        pixels, sigma = thinned(stripe, _STRIPE_POINTS)
        row = self.lasers.index(laser)
        return StripePart(
            pixels, sigma, body, angle, row, self.views[number].across_of(laser), number,
            2 + kind * len(self.lasers) + row,
        )  # fmt: skip


def _common_zero(commanded: Floats, turned: Floats) -> float:
    """Angle of the reference at which most stops stand where they were commanded to."""
    off = (commanded - turned)[np.isfinite(commanded)]
    if len(off) == 0:
        return 0.0
    around = np.angle(np.exp(1j * (off[:, None] - off[None, :])))
    # The member with the least sum of distances is the median of angles.
    return float(off[int(np.argmin(np.abs(around).sum(axis=1)))])
