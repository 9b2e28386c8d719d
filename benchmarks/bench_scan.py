"""A ball and a mug, simulated, calibrated from their own pictures, scanned, and compared with the truth."""

import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from app.calibration.record import CalibrationRecord
from app.geometry.arrays import Floats, Points
from app.geometry.rig import Rig
from app.recording.reader import Recording
from app.recording.simulated import simulate_recording
from app.recording.simulated_plan import SimulationPlan, Views
from app.simulation.objects import make_object
from benchmarks.report import Row, at_most
from benchmarks.simulated_scans import Scan, calibrated, distances_mm, scanned, true_record
from benchmarks.synthetic_views import surface_error_mm

_RADIUS_MM = 30.0
_STEPS = 100
_MUG_STEPS = 60
# Nearer to the table than this, a point may belong to it.
_ABOVE_TABLE_MM = 3.0
_SEEDS = (1, 2, 3)
_VIEWS = Views(axis_line=1, hand_mm=0.5, hand_deg=0.3)


def run() -> list[Row]:
    with tempfile.TemporaryDirectory() as folder:
        plan = SimulationPlan(views=_VIEWS, steps=_STEPS)
        ball = simulate_recording(Path(folder) / "ball", plan)
        joint, paper = calibrated(ball, "joint"), calibrated(ball, "paper")
        rows = _ball_rows(ball, joint, paper, plan)
        mug_plan = replace(plan, item=make_object("mug", None), parts=("scan",), steps=_MUG_STEPS)
        mug = simulate_recording(Path(folder) / "mug", mug_plan)
        return rows + _mug_rows(mug, joint, mug_plan) + _picture_rows(Path(folder))


def _picture_rows(folder: Path) -> list[Row]:
    """The joint calibration from pictures of several scanners' views, against the truth and its own word."""
    errors, told = [], []
    for seed in _SEEDS:
        plan = SimulationPlan(parts=("calibration",), seed=seed)
        recording = simulate_recording(folder / f"rig-{seed}", plan)
        found = calibrated(recording, "joint")
        errors.append(1e3 * surface_error_mm(true_record(recording).rig, found.rig))
        told.append(1e3 * found.expected_error_mm)
    note = ", ".join(f"{error:.1f}" for error in errors)
    return [
        Row("from pictures: surface error, joint", _rms(errors), "um RMS", "", None, f"each {note}"),
        Row("from pictures: error that the calibration tells", _rms(told), "um RMS", "", None),
    ]


def _rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def ball_errors_mm(scan: Scan, centre: Points) -> tuple[Floats, Points]:
    """Distance (N,) of the ball's points to the true ball, and the ball fitted to them (x, y, z, radius).

    The scan has its own frame; where the truth knows better than the scan can, the truth is taken: x and y of
    the centre. The height of the table frame's origin is found from the ball itself.

    Args:
        centre: (3,) true centre in the true table frame.
    """
    start = np.array([*centre[:2], float(scan.points[:, 2].max()) - _RADIUS_MM, _RADIUS_MM])
    ball = start
    for _ in range(3):
        above = scan.points[:, 2] > ball[2] - _RADIUS_MM + _ABOVE_TABLE_MM
        points = scan.points[above]
        ball = _fitted_ball(points, ball)
    placed = np.array([centre[0], centre[1], ball[2]])
    errors: Floats = np.linalg.norm(points - placed, axis=1) - _RADIUS_MM
    return errors, ball


def _fitted_ball(points: Points, start: Floats) -> Floats:
    """Centre and radius (4,) of the ball through points (N, 3), robust."""

    def off(ball: Floats) -> Floats:
        distances: Floats = np.linalg.norm(points - ball[:3], axis=1) - ball[3]
        return distances

    ball: Floats = least_squares(off, start, loss="soft_l1", f_scale=0.1).x
    return ball


def _ball_rows(
    recording: Recording, joint: CalibrationRecord, paper: CalibrationRecord, plan: SimulationPlan
) -> list[Row]:
    truth = true_record(recording).rig
    centre = plan.table_from_item.translation + np.array([0.0, 0.0, _RADIUS_MM])
    rows = []
    for name, rig in (("joint", joint.rig), ("paper's", paper.rig), ("true", truth)):
        start = time.perf_counter()
        scan = scanned(recording, rig)
        took_s = time.perf_counter() - start
        errors, ball = ball_errors_mm(scan, centre)
        rms, furthest = float(np.sqrt(np.mean(errors**2))), float(np.abs(errors).max())
        apart = max((pair.disagreement_mm for pair in scan.agreements), default=float("nan"))
        what = f"ball, {name} calibration"
        note = f"{len(errors)} points, {_STEPS} steps"
        radius = Row(f"{what}: radius, fitted - true", float(ball[3]) - _RADIUS_MM, "mm")
        if name == "joint":
            rows.append(at_most(f"{what}: RMS to the truth", rms, "mm", 0.05, note))
            rows.append(at_most(f"{what}: furthest point", furthest, "mm", 1.0))
            rows.append(at_most(f"{what}: left and right laser", apart, "mm apart", 0.02))
            noise = np.linalg.norm(scan.points - ball[:3], axis=1) - ball[3]
            spread = 1.4826 * float(np.median(np.abs(noise[np.abs(noise) < 1.0])))
            rows.append(Row(f"{what}: surface noise", spread, "mm", note="robust, about the fitted ball"))
            rows.append(Row(f"{what}: time", took_s, "s", note="to reconstruct"))
        else:
            rows.append(Row(f"{what}: RMS to the truth", rms, "mm", note=note))
            rows.append(Row(f"{what}: left and right laser", apart, "mm apart"))
        rows.append(radius)
    return rows


def _mug_rows(recording: Recording, joint: CalibrationRecord, plan: SimulationPlan) -> list[Row]:
    truth, found = true_record(recording).rig, joint.rig
    surface = plan.item.mesh.moved(plan.table_from_item).as_trimesh()
    points = _above_table(scanned(recording, found), found, truth)
    errors = distances_mm(points, surface)
    note = f"{len(points)} points, {_MUG_STEPS} steps"
    return [
        Row("mug, joint calibration: RMS to the truth", float(np.sqrt(np.mean(errors**2))), "mm", note=note),
        Row("mug, joint calibration: median distance", float(np.median(errors)), "mm"),
        Row("mug, joint calibration: 99 % within", float(np.percentile(errors, 99.0)), "mm"),
        Row("mug, joint calibration: furthest point", float(errors.max()), "mm"),
    ]


def _above_table(scan: Scan, found: Rig, truth: Rig) -> Points:
    points = scan.seen_by_camera_of(found, truth)
    above: Points = points[points[:, 2] > _ABOVE_TABLE_MM]
    return above
