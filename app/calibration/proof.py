"""A calibration tried on pictures that it has not seen: the board is scanned, and what is wrong is in mm."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

import numpy as np

from app.calibration.board_views import BoardView, board_views
from app.calibration.record import CalibrationRecord
from app.calibration.views import Evidence
from app.errors import CalibrationError
from app.geometry.arrays import Floats, Points
from app.geometry.plane import LaserPlane, PlaneFit, fit_plane_robust
from app.geometry.rig import Rig
from app.geometry.transform import RigidTransform

PROOF_KEY = "proof"
"""Where a calibration file keeps what the proof found."""

# A surface of the size that is scanned most.
_OBJECT_RADIUS_MM = 50.0
_FEWEST_STOPS = 3
# What corners and tables that are in order are off by.
_CORNER_PX, _TURN_DEG = 0.1, 0.05
# An axis that the few angles of a proof leave more open than this is not judged.
_AXIS_KNOWN_MM = 0.1


class Verdict(StrEnum):
    """How good a number is."""

    GOOD = "good"
    FAIR = "fair"
    BAD = "bad"

    @property
    def level(self) -> str:
        """As a traffic light: green, amber or red."""
        return {Verdict.GOOD: "green", Verdict.FAIR: "amber", Verdict.BAD: "red"}[self]


@dataclass(frozen=True, slots=True)
class ProofFinding:
    """One number of the proof.

    Attributes:
        name: expected, surface, size, axis, wobble, turning or lasers.
        value_mm: it; never negative.
        verdict: what it is worth.
        words: what was found, one sentence.
        cause: what it probably comes from; empty where it is good.
        remedy: what to do about it; empty where it is good.
        good_mm, fair_mm: up to where such a number is good and fair.
    """

    name: str
    value_mm: float
    verdict: Verdict
    words: str
    cause: str
    remedy: str
    good_mm: float
    fair_mm: float

    @property
    def advice(self) -> str:
        """Cause and remedy in one; empty where it is good."""
        return f"{self.cause}: {self.remedy}." if self.cause else ""


@dataclass(frozen=True, slots=True)
class Proof:
    """What the pictures of the proof say.

    Attributes:
        findings: most important first.
        stops: how many angles of the table were used.
        points: how many stripe points.
    """

    findings: tuple[ProofFinding, ...]
    stops: int
    points: int

    @property
    def verdict(self) -> Verdict:
        """The worst of them."""
        order = list(Verdict)
        return max((finding.verdict for finding in self.findings), key=order.index)

    def as_json(self) -> dict[str, Any]:
        """What a calibration file keeps of it."""
        return {
            "verdict": self.verdict.value,
            "level": self.verdict.level,
            "stops": self.stops,
            "points": self.points,
            "findings": [
                {
                    "name": f.name,
                    "value_mm": f.value_mm,
                    "verdict": f.verdict.value,
                    "level": f.verdict.level,
                    "words": f.words,
                    "cause": f.cause,
                    "remedy": f.remedy,
                    "good_mm": f.good_mm,
                    "fair_mm": f.fair_mm,
                }
                for f in self.findings
                if np.isfinite(f.value_mm)
            ],
        }


@dataclass(frozen=True, slots=True)
class _Scale:
    """Up to where a number is good and fair, mm, and what to say where it is not good."""

    good_mm: float
    fair_mm: float
    cause: str
    remedy: str


_SCALES = {
    "expected": _Scale(
        0.1, 0.3,
        "The views leave too much open",
        "calibrate again with the board nearer to the camera, more tilted views, and the two places on the "
        "table further apart",
    ),
    "surface": _Scale(
        0.15, 0.5,
        "The board is not flat, or stripes are blurred or too bright",
        "glue the board to glass or a stiff plate, and run `turnscan doctor`, which judges focus and "
        "exposure",
    ),
    "size": _Scale(
        0.1, 0.3,
        "Camera, lens or laser moved while the pictures were taken, autofocus is on, or the room is too "
        "bright to see the stripes well",
        "fix everything in place, switch autofocus off and calibrate again",
    ),
    "axis": _Scale(
        0.1, 0.3,
        "The axis is not where it was calibrated, because the camera or the table was moved since, or the "
        "board slid while the table turned",
        "fix both in place, stick the board down, and calibrate again",
    ),
    "wobble": _Scale(
        0.1, 0.3,
        "The board slid or swayed on the table, the table is loose on its axis, or the camera is not fixed",
        "stick the board down, tighten the table, and calibrate again",
    ),
    "turning": _Scale(
        0.1, 0.3,
        "The table does not turn as far as it is told, because of lost steps, play in the gear, or a wrong "
        "number of steps per turn",
        "run `turnscan doctor`, which measures which",
    ),
    "lasers": _Scale(
        0.1, 0.3,
        "The lasers do not meet on the same surface, because one of them has moved since the calibration, or "
        "its stripe is too bright or too dim",
        "fix it in place, and calibrate again",
    ),
}  # fmt: skip


def prove(evidence: Evidence, record: CalibrationRecord) -> Proof:
    """Scan the board in pictures that were not calibrated from.

    Args:
        evidence: views of the board on the table, each laser lit in turn; one placement.
        record: the calibration.

    Raises:
        CalibrationError: too little is seen to say anything.
    """
    rig = record.rig
    seen, _ = board_views(evidence, rig.camera)
    last = seen[-1].view.placement if seen else ""
    views = [view for view in seen if view.view.placement == last and np.isfinite(view.view.angle_rad)]
    if len({view.view.angle_rad for view in views}) < _FEWEST_STOPS:
        raise CalibrationError(
            f"The board was seen at {len(views)} angles of the proof only.",
            "Stand the board so that it stays in the picture while the table turns.",
        )
    scanned = _scanned(views, rig)
    if not scanned:
        raise CalibrationError(
            "No laser was seen on the board in the proof.",
            "Aim the lasers at the middle of the table, darken the room, and calibrate again.",
        )
    cloud = np.concatenate(list(scanned.values()))
    fit = fit_plane_robust(cloud)
    sway = _sway(views, rig)
    findings = [
        *_expected(record),
        _surface(fit),
        _size(views, rig, fit.plane),
        *_axis(sway),
        _wobble(sway),
        _turning(sway),
        *_lasers(scanned, fit.plane),
    ]
    return Proof(tuple(findings), len(views), len(cloud))


def _scanned(views: Sequence[BoardView], rig: Rig) -> Mapping[str, Points]:
    """The board as each laser measures it, (N, 3) mm in the table frame."""
    points: dict[str, list[Points]] = {}
    for view in views:
        for laser, stripe in view.stripes.items():
            if laser in rig.lasers:
                measured = rig.triangulate(stripe.pixels, laser, view.view.angle_rad)
                points.setdefault(laser, []).append(measured[np.isfinite(measured).all(axis=1)])
    return {laser: np.concatenate(parts) for laser, parts in points.items()}


def _expected(record: CalibrationRecord) -> list[ProofFinding]:
    if not np.isfinite(record.expected_error_mm):
        return []
    words = f"{record.expected_error_mm:.3f} mm is to be expected at the surface of an object of 100 mm."
    return [_finding("expected", record.expected_error_mm, words)]


def _surface(fit: PlaneFit) -> ProofFinding:
    words = f"Scanned from all angles, the flat board is flat to {fit.rms_mm:.3f} mm RMS."
    return _finding("surface", fit.rms_mm, words)


def _size(views: Sequence[BoardView], rig: Rig, plane: LaserPlane) -> ProofFinding:
    """Corners put on the surface that the lasers measured, against where they are on the board."""
    scales, reach_mm = [], 0.0
    for view in views:
        board = view.view.board
        corners = _table_plane_seen(rig, plane, view.view.angle_rad).intersect_rays(
            rig.camera.rays(board.corners)
        )
        measured, known = _spread(corners), _spread(board.board_points)
        scales.append(measured / known)
        reach_mm = max(reach_mm, float(np.linalg.norm(np.ptp(board.board_points, axis=0))))
    error = float(np.mean(scales)) - 1.0
    words = (
        f"{reach_mm:.0f} mm on the board are measured as {reach_mm * (1.0 + error):.3f} mm "
        f"({100.0 * error:+.2f} %)."
    )
    return _finding("size", abs(error) * reach_mm, words)


def _table_plane_seen(rig: Rig, plane: LaserPlane, angle_rad: float) -> LaserPlane:
    """A plane that turns with the table, in the camera frame."""
    camera_from_table = rig.axis.table_from_camera(angle_rad).inverse()
    foot = camera_from_table @ (plane.normal * plane.distance_mm)[None]
    return LaserPlane.through(foot[0], camera_from_table.rotation @ plane.normal)


def _spread(points: Points) -> float:
    """RMS distance from their middle, mm."""
    return float(np.sqrt(np.mean(np.sum((points - points.mean(axis=0)) ** 2, axis=1))))


@dataclass(frozen=True, eq=False, slots=True)
class _Sway:
    """How a board that stands on the table misses the circle it should go on.

    Attributes:
        off_deg: (K,) true minus told angle at every stop, their mean taken out.
        off_mm: (K,) how far the board is off at every stop besides.
        axis_mm: how far from the calibrated axis it turns.
        axis_sigma_mm: standard deviation of that.
    """

    off_deg: Floats
    off_mm: Floats
    axis_mm: float
    axis_sigma_mm: float


def _sway(views: Sequence[BoardView], rig: Rig) -> _Sway:
    """One place of the board, one shift of the axis and a small turn for each stop, fitted to all corners."""
    corners = [view.view.board.corners for view in views]
    on_board = [view.view.board.board_points for view in views]
    angles = np.array([view.view.angle_rad for view in views])
    across = rig.axis.camera_from_table.rotation[:, :2]

    def missed(numbers: Floats) -> list[Floats]:
        table_from_board = RigidTransform.from_rvec(numbers[:3], numbers[3:6])
        axis = replace(rig.axis, point_mm=rig.axis.point_mm + across @ numbers[6:8])
        errors = []
        for angle, seen, known in zip(angles + numbers[8:], corners, on_board, strict=True):
            camera_from_table = axis.table_from_camera(angle).inverse()
            errors.append(rig.camera.project(camera_from_table @ (table_from_board @ known)) - seen)
        return errors

    def residuals(numbers: Floats) -> Floats:
        in_sigmas = np.concatenate(missed(numbers)).ravel() / _CORNER_PX
        turned = np.degrees(numbers[8:]) / _TURN_DEG
        # The board's own turn and that of all stops are one: the mean turn is held at zero.
        return np.concatenate([in_sigmas, turned, [1e3 * np.mean(turned)]])

    middle = len(views) // 2
    # A quarter of a second, which the server's start can do without.
    from scipy.optimize import least_squares

    start = rig.axis.table_from_camera(angles[middle]) @ views[middle].pose.camera_from_board
    first = np.concatenate([start.rvec, start.translation, np.zeros(2 + len(views))])
    scale = np.concatenate([np.full(3, 0.01), np.ones(5), np.full(len(views), 0.01)])
    solved = least_squares(residuals, first, x_scale=scale, loss="soft_l1")
    px_per_mm = float(rig.camera.matrix[0, 0]) / float(np.linalg.norm(rig.axis.origin))
    off = [np.linalg.norm(error.mean(axis=0)) / px_per_mm for error in missed(solved.x)]
    slopes: Floats = np.asarray(solved.jac, np.float64)
    covariance = np.linalg.pinv(slopes.T @ slopes)[6:8, 6:8]
    return _Sway(
        np.degrees(solved.x[8:]), np.array(off), float(np.linalg.norm(solved.x[6:8])),
        float(np.sqrt(np.trace(covariance))),
    )  # fmt: skip


def _axis(sway: _Sway) -> list[ProofFinding]:
    if not sway.axis_sigma_mm <= _AXIS_KNOWN_MM:
        return []
    words = f"In these pictures the table turns about a line {sway.axis_mm:.3f} mm from the calibrated axis."
    return [_finding("axis", sway.axis_mm, words)]


def _wobble(sway: _Sway) -> ProofFinding:
    worst = float(np.max(sway.off_mm))
    rms = float(np.sqrt(np.mean(sway.off_mm**2)))
    words = f"The board keeps to its circle about the axis to {rms:.3f} mm RMS, {worst:.3f} mm at most."
    return _finding("wobble", rms, words)


def _turning(sway: _Sway) -> ProofFinding:
    worst_deg = float(np.max(np.abs(sway.off_deg)))
    off_mm = float(np.radians(worst_deg)) * _OBJECT_RADIUS_MM
    words = (
        f"The table stands where it is told to within {worst_deg:.2f} degrees: {off_mm:.3f} mm at "
        f"{_OBJECT_RADIUS_MM:.0f} mm from the axis."
    )
    return _finding("turning", off_mm, words)


def _lasers(scanned: Mapping[str, Points], plane: LaserPlane) -> list[ProofFinding]:
    """How far apart the surfaces are that two lasers measure of one board."""
    if len(scanned) < 2:
        return []
    off = {laser: float(np.median(plane.signed_distance(points))) for laser, points in scanned.items()}
    low, high = min(off, key=off.__getitem__), max(off, key=off.__getitem__)
    apart = off[high] - off[low]
    words = f"The lasers {low} and {high} measure the same surface {apart:.3f} mm apart."
    return [_finding("lasers", apart, words)]


def _finding(name: str, value_mm: float, words: str) -> ProofFinding:
    scale = _SCALES[name]
    limits = scale.good_mm, scale.fair_mm
    if value_mm <= scale.good_mm:
        return ProofFinding(name, value_mm, Verdict.GOOD, words, "", "", *limits)
    verdict = Verdict.FAIR if value_mm <= scale.fair_mm else Verdict.BAD
    return ProofFinding(name, value_mm, verdict, words, scale.cause, scale.remedy, *limits)
