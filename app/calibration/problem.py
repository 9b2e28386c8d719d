"""From views to the arrays of the bundle adjustment, with start values for every unknown."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from app.calibration.bare_table import on_bare_table
from app.calibration.bundle import Columns, Corners, State, Stripes
from app.calibration.laser_plane import solve_laser_plane
from app.calibration.lit_together import swapped_pairs
from app.calibration.platter import UNIT_CORNERS, SheetStart, marker_points, start_sheet
from app.calibration.poses import BoardPose, board_pose, points_on_board, stripe_on_board
from app.calibration.print_edges import clear_of_edges
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

CORNER_SIGMA_PX = 0.10
"""Assumed of a corner until the residuals tell."""
_STRIPE_SIGMA_FLOOR_PX = 0.02
_STRIPE_POINTS = 120
_FEWEST_STRIPE_POINTS = 12
_WORST_VIEW_PX = 2.0
# Around a marker, in sides from its centre, the stripe is taken to lie on the table.
_MARKER_CLEAR, _MARKER_SURROUND = 0.65, 1.3
_FEWEST_FOR_SCALE = 150


@dataclass(frozen=True, eq=False, slots=True)
class BoardView:
    """A view of the board with its pose and the stripe points that fall on it."""

    view: View
    pose: BoardPose
    stripes: Mapping[str, LaserStripe]

    def points(self, camera: CameraIntrinsics, laser: str) -> Points:
        """The stripe's points (N, 3) mm in the camera frame."""
        return points_on_board(camera, self.pose.camera_from_board, self.stripes[laser].pixels)


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


def board_views(
    evidence: Evidence, camera: CameraIntrinsics, excluded: frozenset[str] = frozenset()
) -> tuple[list[BoardView], list[tuple[str, str]]]:
    """Pose of the board in every view that shows it, and which stripe points fall on it.

    Args:
        excluded: names of views that another step found to be bad.

    Returns:
        the usable views, and those left out with the reason.
    """
    seen: list[BoardView] = []
    dropped: list[tuple[str, str]] = []
    for view in evidence.views:
        if not view.board.is_found or view.name in excluded or evidence.board is None:
            continue
        pose = board_pose(camera, view.board.corners, view.board.board_points)
        if pose.rms_px > _WORST_VIEW_PX:
            dropped.append((view.name, f"the board fits to {pose.rms_px:.1f} px only"))
            continue
        stripes = {}
        for laser, stripe in view.stripes.items():
            lies_on = stripe_on_board(camera, pose.camera_from_board, evidence.board, stripe.pixels)
            on_board = stripe.select(lies_on)
            is_clear = clear_of_edges(
                camera, pose.camera_from_board, evidence.board, on_board, view.across_of(laser)
            )
            if np.count_nonzero(is_clear) >= _FEWEST_STRIPE_POINTS:
                stripes[laser] = on_board.select(is_clear)
        seen.append(BoardView(view, pose, stripes))
    return _told_apart(seen, camera), dropped


def _told_apart(boards: list[BoardView], camera: CameraIntrinsics) -> list[BoardView]:
    """The same views, each stripe given to its laser where two were lit in one picture."""
    for names in {board.view.together for board in boards if len(board.view.together) == 2}:
        shared = [
            k for k, b in enumerate(boards) if b.view.together == names and b.stripes.keys() >= set(names)
        ]
        pairs = [(boards[k].points(camera, names[0]), boards[k].points(camera, names[1])) for k in shared]
        across = boards[shared[0]].view.across_of(names[0]) if shared else 0
        for k, is_swapped in zip(shared, swapped_pairs(pairs, across), strict=True):
            if is_swapped:
                stripes = dict(boards[k].stripes)
                stripes[names[0]], stripes[names[1]] = stripes[names[1]], stripes[names[0]]
                boards[k] = replace(boards[k], stripes=stripes)
    return boards


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
            laser for laser in evidence.lasers if sum(laser in b.stripes for b in boards) >= 2
        )
        self.groups: list[str] = ["board corners", "marker corners"]
        self.groups += [f"stripe {laser} on boards" for laser in self.lasers]
        self.groups += [f"stripe {laser} on the table" for laser in self.lasers]
        self.placements: dict[str, list[BoardView]] = {}
        for board in boards:
            if board.view.role is Role.AXIS:
                self.placements.setdefault(board.view.placement, []).append(board)
        self.axis, self.has_axis = self._axis()

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
        view_angle = np.full(len(self.views), -1, np.intp)
        angles: list[float] = []
        bodies: list[RigidTransform] = []
        corner_parts: list[_CornerPart] = []
        stripe_parts: list[_StripePart] = []
        sheet = -1
        planes = self._planes()
        if self.start is not None and self.has_axis:
            sheet = 0
            reference = int(np.argmin([p.rms_px for p in self.start.poses]))
            poses = [p.camera_from_board for p in self.start.poses]
            turned = [self._turned(poses[reference], other) for other in poses]
            zero = _common_zero(np.array([v.angle_rad for v in self.marked]), np.array(turned))
            bodies.append(self._at_zero(poses[reference], zero))
            table_stripes = self._on_table(self.start, planes)
            for view, turn, found in zip(self.marked, turned, self.start.poses, strict=True):
                if not np.isfinite(found.rms_px):
                    continue
                number = self.view_number[view.name]
                view_angle[number] = len(angles)
                angles.append(zero + turn)
                corner_parts.append(self._marker_corners(view, number, view_angle[number], self.start.ids))
                for laser, stripe in table_stripes.get(view.name, {}).items():
                    stripe_parts.append(self._stripe(stripe, number, 0, view_angle[number], laser, 1))
        placed: dict[str, int] = {}
        for board in self.boards:
            number = self.view_number[board.view.name]
            body = len(bodies)
            if board.view.role is Role.AXIS and self.has_axis:
                first = self.placements[board.view.placement][0]
                pose, pose_first = board.pose.camera_from_board, first.pose.camera_from_board
                if board is first:
                    if view_angle[number] < 0:
                        view_angle[number] = len(angles)
                        angles.append(0.0 if np.isnan(board.view.angle_rad) else board.view.angle_rad)
                    placed[board.view.placement] = body
                    bodies.append(self._at_zero(pose, angles[view_angle[number]]))
                else:
                    body = placed[board.view.placement]
                    if view_angle[number] < 0:
                        zero = angles[view_angle[self.view_number[first.view.name]]]
                        view_angle[number] = len(angles)
                        angles.append(zero + self._turned(pose_first, pose))
            else:
                bodies.append(board.pose.camera_from_board)
            angle = view_angle[number]
            corner_parts.append(_board_corners(board.view, number, body, angle))
            for laser, stripe in board.stripes.items():
                # In the paper's axis pictures the laser may have been moved to run along the axis.
                if laser in self.lasers and board.view.role is not Role.AXIS_LINE:
                    stripe_parts.append(self._stripe(stripe, number, body, angle, laser, 0))
        corners, corner_view = _joined_corners(corner_parts)
        stripes, stripe_view = _joined_stripes(stripe_parts)
        state = State(
            vector_from_camera(self.camera),
            self.camera.size,
            self.axis.point_mm,
            self.axis.direction,
            planes,
            np.array([b.rotation for b in bodies]).reshape(-1, 3, 3),
            np.array([b.translation for b in bodies]).reshape(-1, 3),
            np.array(angles),
            self.start.layout if self.start is not None and sheet >= 0 else np.zeros((0, 3)),
            self.marker_mm,
        )
        on_table = stripes.group >= 2 + len(self.lasers)
        return Problem(
            state,
            corners,
            stripes,
            _free_columns(state, corners, stripes, camera_columns, self.has_axis, int(on_table.sum())),
            self.lasers,
            self.start.ids if self.start is not None and sheet >= 0 else (),
            sheet,
            tuple(self.views),
            view_angle,
            corner_view,
            stripe_view,
            tuple(self.groups),
            self.has_axis,
            dropped,
            tuple(self.warnings),
        )

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
            plane = solve_laser_plane(laser, poses).plane
            planes[row] = [*plane.normal, plane.distance_mm]
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

    def _marker_corners(self, view: View, number: int, angle: np.intp, ids: tuple[int, ...]) -> "_CornerPart":
        known = [k for k, i in enumerate(view.markers.ids) if int(i) in ids]
        row = np.array([ids.index(int(view.markers.ids[k])) for k in known], np.intp)
        return _CornerPart(
            view.markers.corners[known].reshape(-1, 2),
            np.tile(UNIT_CORNERS, (len(known), 1)),
            np.repeat(row, 4),
            0,
            int(angle),
            number,
            1,
        )

    def _stripe(
        self, stripe: LaserStripe, number: int, body: int, angle: np.intp, laser: str, kind: int
    ) -> "_StripePart":
        pixels, sigma = thinned(stripe, _STRIPE_POINTS)
        row = self.lasers.index(laser)
        return _StripePart(
            pixels, sigma, body, int(angle), row, self.views[number].across_of(laser), number,
            2 + kind * len(self.lasers) + row,
        )  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class _CornerPart:
    pixels: Floats
    on_body: Floats
    marker: Indices
    body: int
    angle: int
    view: int
    group: int


@dataclass(frozen=True, eq=False, slots=True)
class _StripePart:
    pixels: Floats
    sigma: Floats
    body: int
    angle: int
    laser: int
    across: int
    view: int
    group: int


def thinned(stripe: LaserStripe, most: int) -> tuple[Floats, Floats]:
    """Means of neighbouring points of one segment, so that a stripe has about `most` of them.

    Returns:
        (M, 2) pixels and (M,) sigma across the stripe.
    """
    together = max(1, -(-len(stripe) // most))
    bundle = np.concatenate([[0], np.cumsum((np.diff(stripe.segment) != 0) | (np.diff(stripe.line) > 2))])
    position = np.arange(len(stripe)) - np.searchsorted(bundle, bundle)
    key = bundle * (len(stripe) + 1) + position // together
    _, index, count = np.unique(key, return_inverse=True, return_counts=True)
    pixels = np.column_stack([np.bincount(index, stripe.pixels[:, k]) / count for k in (0, 1)])
    variance = np.bincount(index, stripe.variance) / count
    return pixels, np.sqrt(np.maximum(variance, _STRIPE_SIGMA_FLOOR_PX**2) / count)


def _common_zero(commanded: Floats, turned: Floats) -> float:
    """Angle of the reference at which most stops stand where they were commanded to."""
    off = (commanded - turned)[np.isfinite(commanded)]
    if len(off) == 0:
        return 0.0
    around = np.angle(np.exp(1j * (off[:, None] - off[None, :])))
    # The member with the least sum of distances is the median of angles.
    return float(off[int(np.argmin(np.abs(around).sum(axis=1)))])


def _board_corners(view: View, number: int, body: int, angle: np.intp) -> _CornerPart:
    seen = view.board
    none = np.full(len(seen.ids), -1, np.intp)
    return _CornerPart(seen.corners, seen.board_points, none, body, int(angle), number, 0)


def _each(parts: Sequence[_CornerPart] | Sequence[_StripePart], field: str) -> Indices:
    sizes = [len(part.pixels) for part in parts]
    return np.repeat(np.array([getattr(part, field) for part in parts], np.intp), sizes)


def _joined_corners(parts: Sequence[_CornerPart]) -> tuple[Corners, Indices]:
    pixels = np.concatenate([np.zeros((0, 2)), *(p.pixels for p in parts)])
    corners = Corners(
        pixels,
        _each(parts, "body"),
        _each(parts, "angle"),
        np.concatenate([np.zeros((0, 3)), *(p.on_body for p in parts)]),
        np.concatenate([np.zeros(0, np.intp), *(p.marker for p in parts)]),
        np.full(len(pixels), CORNER_SIGMA_PX),
        _each(parts, "group"),
    )
    return corners, _each(parts, "view")


def _joined_stripes(parts: Sequence[_StripePart]) -> tuple[Stripes, Indices]:
    stripes = Stripes(
        np.concatenate([np.zeros((0, 2)), *(p.pixels for p in parts)]),
        _each(parts, "body"),
        _each(parts, "angle"),
        _each(parts, "laser"),
        _each(parts, "across"),
        np.concatenate([np.zeros(0), *(p.sigma for p in parts)]),
        _each(parts, "group"),
    )
    return stripes, _each(parts, "view")


def _free_columns(
    state: State,
    corners: Corners,
    stripes: Stripes,
    camera_columns: Sequence[int],
    has_axis: bool,
    on_table: int,
) -> Indices:
    at = Columns.of(state)
    free = np.ones(at.total, np.bool_)
    free[:9] = False
    free[list(camera_columns)] = True
    free[9:13] = has_axis
    for angle in _gauge_angles(len(state.angles), corners):
        free[at.angles + angle] = False
    # The first marker is the origin of the sheet; its side is known only against the laser's plane.
    free[at.layout : at.layout + 3] = False
    free[at.side] = on_table >= _FEWEST_FOR_SCALE
    return np.flatnonzero(free)


def _gauge_angles(count: int, corners: Corners) -> list[int]:
    """One angle of each group that bodies tie together: a body and its angles can turn as one."""
    leader = list(range(count))

    def find(angle: int) -> int:
        while leader[angle] != angle:
            angle = leader[angle]
        return angle

    first: dict[int, int] = {}
    pairs = np.unique(np.column_stack([corners.body, corners.angle]), axis=0)
    for body, angle in pairs[pairs[:, 1] >= 0].tolist():
        if body in first:
            leader[find(angle)] = find(first[body])
        else:
            first[body] = angle
    return sorted({find(angle) for angle in range(count)})
