"""Views of a rig with known truth, as numbers: exact corners and stripe points plus normal noise.

No picture is rendered, so a calibration can be repeated a hundred times; the noise is what detection
leaves (corners 0.10 px, stripe 0.15 px unless said otherwise).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from app.calibration.platter import marker_points
from app.calibration.views import Evidence, View
from app.geometry.arrays import Floats, Pixels, Points, Vector3
from app.geometry.axis import TurntableAxis
from app.geometry.camera import CameraIntrinsics
from app.geometry.plane import LaserPlane
from app.geometry.rig import Rig
from app.geometry.transform import RigidTransform, rotation_about, rotation_from_rvec
from app.recording.shot import Role
from app.vision.board import BoardObservation, BoardSpec
from app.vision.markers import MarkerObservation, PlatterSpec
from app.vision.stripe import LaserStripe

BOARD = BoardSpec("chessboard", 9, 6, 10.0)
PLATTER = PlatterSpec("DICT_4X4_50", 20.0, (3, 7, 11, 12))
SHEET = np.array([[30.0, 24.0, 0.3], [-28.0, 31.0, 1.8], [-33.0, -26.0, -0.7], [29.0, -32.0, 3.0]])
"""Where the markers truly lie: x mm, y mm, rotation rad in the table frame."""

_TABLE_RADIUS_MM = 70.0
_NO_BOARD = BoardObservation(np.zeros(0, np.intp), np.zeros((0, 2)), np.zeros((0, 3)))
_NO_MARKERS = MarkerObservation(np.zeros(0, np.intp), np.zeros((0, 4, 2)))


def typical_rig(lasers: int = 1, distortion: Sequence[float] = (-0.12, 0.05, 0.0005, -0.0004, 0.0)) -> Rig:
    """f = 1400 px, object at 300 mm, lasers 30 degrees beside the camera, which looks down by 25 degrees."""
    matrix = np.array([[1400.0, 0.0, 639.5], [0.0, 1400.0, 359.5], [0.0, 0.0, 1.0]])
    camera = CameraIntrinsics(matrix, np.array(distortion), (1280, 720))
    tilt = np.radians(25.0)
    axis = TurntableAxis(np.array([1.5, 35.0, 305.0]), np.array([0.0, -np.cos(tilt), -np.sin(tilt)]), 0.0)
    planes = {}
    for name, sign in (("left", 1.0), ("right", -1.0))[:lasers]:
        angle = np.radians(30.0) * sign
        along = np.array([np.sin(angle), 0.0, np.cos(angle)])
        normal = np.cross(axis.direction, along)
        planes[name] = LaserPlane.through(axis.point_mm + np.array([0.8 * sign, 0.0, 0.3]), normal)
    return Rig(camera, planes, axis)


@dataclass(frozen=True, slots=True)
class Noise:
    """What detection leaves, px."""

    corner_px: float = 0.10
    stripe_px: float = 0.15


@dataclass(slots=True)
class SyntheticViews:
    """Adds views one by one; `evidence()` hands them over."""

    rig: Rig
    rng: np.random.Generator
    noise: Noise = field(default_factory=Noise)
    views: list[View] = field(default_factory=list)
    board: BoardSpec = BOARD
    jitter_deg: float = 0.14

    def free_boards(self, count: int, *, role: Role = Role.INTRINSICS) -> None:
        """Boards held in the hand, tilted, near and far, all over the picture."""
        middle = self.board.points().mean(axis=0)
        while count:
            rvec = self.rng.normal(size=3) * [0.45, 0.45, 0.3]
            depth = self.rng.uniform(240.0, 380.0)
            centre = np.array([self.rng.uniform(-0.3, 0.3), self.rng.uniform(-0.15, 0.15), 1.0]) * depth
            rotation = rotation_from_rvec(rvec) @ np.diag([1.0, -1.0, -1.0])
            pose = RigidTransform(rotation, centre - rotation @ middle)
            if self._add(pose, role, "", float("nan")):
                count -= 1

    def placement(self, number: int, angles_deg: Sequence[float], beside_mm: float, yaw_deg: float) -> None:
        """A board standing on the table, beside the axis, seen at several angles of the table.

        Args:
            beside_mm: distance of its plane from the axis; through the axis the method is blind.
            yaw_deg: which way it faces at table angle zero, from straight at the camera.
        """
        axis = self.rig.axis
        turn = rotation_about(axis.direction, np.radians(yaw_deg))
        towards = axis.camera_from_table.rotation[:, 0]
        x, y, z = np.cross(axis.direction, towards), axis.direction, towards
        rotation = turn @ np.column_stack([x, y, z])
        middle = self.board.points().mean(axis=0)
        centre = axis.origin + 40.0 * axis.direction + turn @ (beside_mm * towards)
        upright = RigidTransform(rotation, centre - rotation @ middle)
        for angle_deg in angles_deg:
            angle = np.radians(angle_deg + self.rng.normal() * self.jitter_deg)
            turned = rotation_about(axis.direction, angle)
            pose = RigidTransform(
                turned @ upright.rotation,
                turned @ (upright.translation - axis.point_mm) + axis.point_mm,
            )
            self._add(pose, Role.AXIS, str(number), np.radians(angle_deg))

    def markers(self, angles_deg: Sequence[float], true_deg: Sequence[float], marker_mm: float) -> None:
        """The bare table with its markers, at several angles, each laser on in turn.

        Args:
            angles_deg: as commanded.
            true_deg: where the table really stands.
            marker_mm: the side that was really printed.
        """
        still = self.rig.axis.camera_from_table
        corners = marker_points(SHEET, marker_mm)
        for commanded, true in zip(angles_deg, true_deg, strict=True):
            turn = rotation_about(np.array([0.0, 0.0, 1.0]), float(np.radians(true)))
            pose = still @ RigidTransform(turn, np.zeros(3))
            seen = self.rig.camera.project(pose @ corners.reshape(-1, 3))
            seen = seen + self.rng.normal(size=seen.shape) * self.noise.corner_px
            inside = _inside(seen, self.rig.camera.size).reshape(-1, 4).all(axis=1)
            reach = np.full(2, _TABLE_RADIUS_MM)
            self._append(
                Role.SCAN,
                "",
                float(np.radians(commanded)),
                _NO_BOARD,
                MarkerObservation(np.array(PLATTER.ids)[inside], seen.reshape(-1, 4, 2)[inside]),
                self._stripes(pose, -reach, reach),
            )

    def evidence(self) -> Evidence:
        is_marked = any(view.markers.is_found for view in self.views)
        return Evidence(
            self.rig.camera.size,
            tuple(self.rig.lasers),
            self.board,
            PLATTER if is_marked else None,
            tuple(self.views),
        )

    def _add(self, pose: RigidTransform, role: Role, placement: str, angle_rad: float) -> bool:
        points = self.board.points()
        corners = self.rig.camera.project(pose @ points)
        if not _inside(corners, self.rig.camera.size).all():
            return False
        corners = corners + self.rng.normal(size=corners.shape) * self.noise.corner_px
        stripes = {}
        if role is not Role.INTRINSICS:
            # A margin of one square carries the stripe too.
            edge = points[:, :2].min(axis=0) - 10.0, points[:, :2].max(axis=0) + 10.0
            stripes = self._stripes(pose, *edge)
        seen = BoardObservation(np.arange(len(points)), corners, points)
        self._append(role, placement, angle_rad, seen, _NO_MARKERS, stripes)
        return True

    def _append(
        self,
        role: Role,
        placement: str,
        angle_rad: float,
        board: BoardObservation,
        markers: MarkerObservation,
        stripes: dict[str, LaserStripe],
    ) -> None:
        name = f"{role.value}-{len(self.views):03d}"
        self.views.append(View(name, role, placement, angle_rad, board, markers, stripes))

    def _stripes(self, pose: RigidTransform, low: Floats, high: Floats) -> dict[str, LaserStripe]:
        found = {name: self._stripe(pose, plane, low, high) for name, plane in self.rig.lasers.items()}
        return {name: stripe for name, stripe in found.items() if len(stripe)}

    def _stripe(self, pose: RigidTransform, plane: LaserPlane, low: Floats, high: Floats) -> LaserStripe:
        """Stripe on a flat thing between two of its corners, once in every row."""
        line_point, line_direction = _meeting_line(plane, pose)
        dense = line_point + np.linspace(-200.0, 200.0, 20001)[:, None] * line_direction
        on_body = pose.inverse() @ dense
        dense = dense[np.all((on_body[:, :2] > low) & (on_body[:, :2] < high), axis=1)]
        if len(dense) < 100:
            return LaserStripe.empty()
        pixels = self.rig.camera.project(dense)
        order = np.argsort(pixels[:, 1])
        rows = np.arange(np.ceil(pixels[:, 1].min()), np.floor(pixels[:, 1].max()))
        columns = np.interp(rows, pixels[order, 1], pixels[order, 0])
        return stripe_from(columns, rows, self.noise.stripe_px, self.rng)


def stripe_from(columns: Floats, rows: Floats, sigma_px: float, rng: np.random.Generator) -> LaserStripe:
    """A stripe with true centres and normal noise."""
    n = len(rows)
    return LaserStripe(
        np.column_stack([columns + rng.normal(size=n) * sigma_px, rows]),
        rows.astype(np.intp),
        np.full(n, 150.0),
        np.full(n, sigma_px**2),
        np.full(n, 2.0),
        np.zeros(n),
        np.zeros(n, np.intp),
        np.zeros(n, np.bool_),
    )


def surface_error_mm(truth: Rig, found: Rig, radius_mm: float = 50.0, *, is_aligned: bool = True) -> float:
    """RMS, across the surface, of a cylinder about the true axis as the found rig scans it.

    The cylinder's stripes are seen by the true rig without noise; the found rig triangulates them, turns
    them about its own axis through the whole circle, and the result is compared with the true cylinder
    after the best rigid alignment (where the scan frame lies is no error of the surface), or without it.
    """
    from app.calibration.error_budget import object_pixels

    theirs: list[Points] = []
    ours: list[Points] = []
    for laser in truth.lasers:
        pixels = object_pixels(truth, laser, radius_mm)
        for angle in np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False):
            theirs.append(truth.triangulate(pixels, laser, angle))
            ours.append(found.triangulate(pixels, laser, angle))
    true, seen = np.concatenate(theirs), np.concatenate(ours)
    aligned = _aligned(seen, true) if is_aligned else seen
    normal = true.copy()
    normal[:, 2] = 0.0
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    return float(np.sqrt(np.mean(np.sum((aligned - true) * normal, axis=1) ** 2)))


def _aligned(points: Points, target: Points) -> Points:
    """The points moved rigidly onto their targets (Kabsch)."""
    a, b = points - points.mean(axis=0), target - target.mean(axis=0)
    u, _, vt = np.linalg.svd(a.T @ b)
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    moved: Points = a @ (u @ flip @ vt) + target.mean(axis=0)
    return moved


def _inside(pixels: Pixels, size: tuple[int, int]) -> NDArray[np.bool_]:
    inside: NDArray[np.bool_] = np.all((pixels > 2.0) & (pixels < np.array(size) - 3.0), axis=1)
    return inside


def _meeting_line(plane: LaserPlane, pose: RigidTransform) -> tuple[Vector3, Vector3]:
    normal = pose.rotation[:, 2]
    direction = np.cross(plane.normal, normal)
    direction /= np.linalg.norm(direction)
    rows = np.array([plane.normal, normal, direction])
    values = np.array([plane.distance_mm, normal @ pose.translation, direction @ pose.translation])
    return np.linalg.solve(rows, values), direction
