"""The paper's calibration and Horus's, on numeric views, for the joint one to be measured against."""

import numpy as np

from app.calibration.laser_plane import solve_laser_plane
from app.calibration.poses import board_pose, points_on_board
from app.calibration.turntable_axis import solve_axis_line
from app.calibration.views import Evidence, View
from app.geometry.arrays import Floats, Pixels, Points, Vector3, unit
from app.geometry.axis import TurntableAxis
from app.geometry.camera import CameraIntrinsics
from app.geometry.plane import LaserPlane, fit_plane
from app.geometry.rig import Rig
from app.geometry.transform import RigidTransform, rotation_about
from app.recording.shot import Role
from benchmarks.synthetic_views import BOARD, Noise

_LINE_MM = (5.0, 75.0)


def laser_planes(evidence: Evidence, camera: CameraIntrinsics) -> dict[str, LaserPlane]:
    """Each view's board by itself, rays meet its plane, SVD over all points: the paper's way and Horus's."""
    planes = {}
    for laser in evidence.lasers:
        poses = [
            points_on_board(camera, _pose(camera, view), view.stripes[laser].pixels)
            for view in evidence.views
            if laser in view.stripes
        ]
        planes[laser] = solve_laser_plane(laser, poses, robust=False).plane
    return planes


def horus_rig(evidence: Evidence, camera: CameraIntrinsics) -> Rig:
    """The axis from the board's middle as it goes round: a plane through its places, a circle in that plane.

    Each placement gives an axis of its own; their mean is taken.
    """
    board = evidence.board or BOARD
    placements: dict[str, list[Vector3]] = {}
    for view in evidence.views:
        if view.role is Role.AXIS:
            middle = _pose(camera, view) @ board.points().mean(axis=0)[None]
            placements.setdefault(view.placement, []).append(middle[0])
    points, directions = [], []
    for places in placements.values():
        centre, direction = _circle(np.array(places))
        points.append(centre)
        directions.append(direction)
    direction = unit(np.sum(directions, axis=0))
    # Where each placement's axis passes the height of the first one's circle.
    moved = [p + float((points[0] - p) @ direction) / float(d @ direction) * d
             for p, d in zip(points, directions, strict=True)]  # fmt: skip
    axis = TurntableAxis(np.mean(moved, axis=0), direction)
    return Rig(camera, laser_planes(evidence, camera), axis)


def paper_rig(evidence: Evidence, camera: CameraIntrinsics, line: Points) -> Rig:
    """Laser planes as above; the axis is the laser line on a board that stands through it.

    Args:
        line: (N, 3) what `axis_line_points` saw.
    """
    return Rig(camera, laser_planes(evidence, camera), solve_axis_line(line).axis)


def axis_line_points(
    rig: Rig, rng: np.random.Generator, noise: Noise, hand_mm: float, hand_deg: float
) -> Points:
    """The laser line (N, 3) mm along a board through the axis, as the camera sees both.

    Args:
        hand_mm, hand_deg: standard deviations with which a hand brings the board's plane to the axis, and
            then the laser line on it: aside by so much and leaning by so much.
    """
    axis = rig.axis
    facing, aside, up = axis.camera_from_table.rotation.T
    miss_mm = hand_mm * rng.standard_normal(2)
    lean_rad = np.radians(hand_deg) * rng.standard_normal(2)
    middle = axis.origin + float(np.mean(_LINE_MM)) * up
    # The board leans to the camera, and the line on it leans to its side.
    board_up = rotation_about(aside, float(lean_rad[0])) @ up
    normal = np.cross(aside, board_up)
    line_up = rotation_about(normal, float(lean_rad[1])) @ board_up
    # The board is wide; its middle stands a little beside the line.
    rotation = np.column_stack([aside, -board_up, np.cross(aside, -board_up)])
    centre = middle + miss_mm[0] * facing
    pose = RigidTransform(rotation, centre - rotation @ BOARD.points().mean(axis=0))
    corners = rig.camera.project(pose @ BOARD.points())
    corners = corners + rng.normal(size=corners.shape) * noise.corner_px
    half_mm = 0.5 * (_LINE_MM[1] - _LINE_MM[0])
    along = np.linspace(-half_mm, half_mm, 300)[:, None] * line_up
    seen: Pixels = rig.camera.project(centre + miss_mm[1] * aside + along)
    seen = seen + np.column_stack([rng.normal(size=len(seen)) * noise.stripe_px, np.zeros(len(seen))])
    found = board_pose(rig.camera, corners, BOARD.points()).camera_from_board
    return points_on_board(rig.camera, found, seen)


def _pose(camera: CameraIntrinsics, view: View) -> RigidTransform:
    return board_pose(camera, view.board.corners, view.board.board_points).camera_from_board


def _circle(places: Points) -> tuple[Vector3, Vector3]:
    """Centre and upward normal of the circle through (N, 3) places."""
    plane = fit_plane(places)
    normal = plane.plane.normal if plane.plane.normal[1] < 0.0 else -plane.plane.normal
    x = unit(np.cross(normal, np.array([0.0, 0.0, 1.0])))
    y = np.cross(normal, x)
    flat = (places - plane.centroid) @ np.column_stack([x, y])
    # x^2 + y^2 = 2 a x + 2 b y + c
    rows = np.column_stack([2.0 * flat, np.ones(len(flat))])
    solved: Floats = np.linalg.lstsq(rows, np.sum(flat**2, axis=1), rcond=None)[0]
    return plane.centroid + solved[0] * x + solved[1] * y, normal
