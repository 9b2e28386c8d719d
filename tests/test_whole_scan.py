"""From pictures of boards to a measured ball, in the simulated scanner.

What the cloud is compared with: a calibration knows neither how high the table is nor, to the last tenth of
a degree, how the camera looks (a principal point that is off tilts the camera's frame), and neither changes
the object. So the ball is measured in the scan frame that was found, about the true place of its centre
beside the axis, at the height at which it is seen.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

from app.calibration.calibrate import calibrate
from app.calibration.outcome import CalibrationOutcome
from app.calibration.plan import CalibrationPlan
from app.geometry.arrays import Floats
from app.geometry.cloud import PointCloud
from app.geometry.rig import Rig
from app.recording.reader import Recording
from app.recording.simulated import simulate_recording
from app.recording.simulated_plan import AngleError, SimulationPlan, Views
from app.scanning.report import ReconstructionReport
from app.scanning.sources import reconstruct_recording, scan_detector
from app.simulation.noise import Noise
from app.simulation.rig import standard_rig
from app.vision.markers import PlatterSpec
from app.vision.stripe import STRIPE_DETECTORS

RADIUS_MM = 30.0


@dataclass(frozen=True, eq=False)
class Ball:
    """A scanned ball.

    Attributes:
        points: (N, 3) mm of the ball without its foot, scan frame.
        laser: (N,) which laser saw each.
        centre: (3,) mm; beside the axis where it truly is, as high as it is seen.
    """

    points: Floats
    laser: Floats
    centre: Floats

    @property
    def off_mm(self) -> Floats:
        """(N,) distance of each point from the true surface."""
        off: Floats = np.linalg.norm(self.points - self.centre, axis=1) - RADIUS_MM
        return off


def ball_of(cloud: PointCloud, plan: SimulationPlan) -> Ball:
    points = cloud.points.astype(np.float64)
    top = points[:, 2].max()
    is_ball = points[:, 2] > top - 55.0
    beside = plan.table_from_item.translation[:2]
    fitted = sphere(points[is_ball], np.array([*beside, top - RADIUS_MM, RADIUS_MM]))
    return Ball(points[is_ball], cloud.laser[is_ball], np.array([*beside, fitted[2]]))


def sphere(points: Floats, start: Floats) -> Floats:
    """Centre and radius (4,) of the ball that fits best."""

    def off(x: Floats) -> Floats:
        return np.asarray(np.linalg.norm(points - x[:3], axis=1) - x[3])

    return np.asarray(least_squares(off, start).x, np.float64)


def scanned(recording: Recording, rig: Rig) -> tuple[PointCloud, ReconstructionReport]:
    run = reconstruct_recording(recording, rig, scan_detector())
    cloud = PointCloud.joined([profile.cloud for profile in run])
    return cloud, run.report()


def calibrated(recording: Recording) -> CalibrationOutcome:
    return calibrate([recording], STRIPE_DETECTORS.make("zero-crossing"), CalibrationPlan())


@dataclass(frozen=True, eq=False)
class Whole:
    """A scanner that was calibrated from its own pictures, and what it made of a ball."""

    outcome: CalibrationOutcome
    ball: Ball
    report: ReconstructionReport


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Whole:
    plan = SimulationPlan(steps=36, noise=Noise(speckle=0.2))
    recording = simulate_recording(tmp_path_factory.mktemp("whole") / "ball", plan)
    outcome = calibrated(recording)
    cloud, report = scanned(recording, outcome.record.rig)
    return Whole(outcome, ball_of(cloud, plan), report)


def test_the_calibration_trusts_itself(whole: Whole) -> None:
    assert whole.outcome.doubts == ()
    assert whole.outcome.dropped == ()
    assert 0.5 < whole.outcome.chi < 1.5
    assert whole.outcome.record.expected_error_mm < 0.01


def test_the_ball_is_true_to_a_twentieth_of_a_millimetre(whole: Whole) -> None:
    assert len(whole.ball.points) > 15_000
    assert np.sqrt(np.mean(whole.ball.off_mm**2)) <= 0.05
    assert np.abs(whole.ball.off_mm).max() <= 1.0


def test_both_lasers_see_the_same_ball(whole: Whole) -> None:
    (pair,) = whole.report.agreements
    assert pair.disagreement_mm <= 0.02
    start = np.array([*whole.ball.centre, RADIUS_MM])
    left, right = (sphere(whole.ball.points[whole.ball.laser == k], start) for k in (0, 1))
    assert np.abs(left - right).max() <= 0.02


SMALL = standard_rig(640, 360)


def small_scan(folder: Path, **changes: Any) -> tuple[Ball, ReconstructionReport]:
    """A ball scanned with the true rig."""
    plan = replace(SimulationPlan(scanner=SMALL, parts=("scan",), steps=24), **changes)
    cloud, report = scanned(simulate_recording(folder, plan), plan.scanner.rig)
    return ball_of(cloud, plan), report


def rms(ball: Ball) -> float:
    return float(np.sqrt(np.mean(ball.off_mm**2)))


def test_the_way_the_table_turns_does_not_mirror_the_object(tmp_path: Path) -> None:
    for direction in ("ccw", "cw"):
        ball, _ = small_scan(tmp_path / direction, direction=direction)
        # Five millimetres beside the axis, a mirrored ball would be that far off.
        assert rms(ball) < 0.1
        assert np.abs(ball.off_mm).max() < 1.0


def test_a_table_that_turns_steadily_is_scanned_by_its_clock(tmp_path: Path) -> None:
    ball, report = small_scan(tmp_path / "steady", seconds_per_turn=12.0, lasers=("left",))
    assert report.angles.source == "constant speed"
    assert rms(ball) < 0.1


def test_markers_put_right_what_the_motor_lost(tmp_path: Path) -> None:
    plan = SimulationPlan(
        scanner=SMALL,
        views=Views(intrinsics=10, laser_plane=5),
        steps=36,
        platter=PlatterSpec("DICT_4X4_50", 20.0, (0, 1, 2, 3)),
        angle_error=AngleError(jitter_deg=0.02, lost_steps=1, lost_deg=1.5),
    )
    recording = simulate_recording(tmp_path / "lost", plan)
    rig = calibrated(recording).record.rig
    cloud, report = scanned(recording, rig)
    assert "the motor lost steps" in report.angles.sentence
    assert report.angles.largest_deg == pytest.approx(1.5, abs=0.15)
    assert rms(ball_of(cloud, plan)) < 0.1
    # With markers the table has its place, so the ball stands on it.
    assert ball_of(cloud, plan).centre[2] == pytest.approx(RADIUS_MM, abs=0.1)


def test_the_same_seed_gives_the_same_points_to_the_last_bit(tmp_path: Path) -> None:
    first, second = (
        small_scan(tmp_path / name, scanner=standard_rig(320, 180), steps=6, seed=5)[0] for name in "ab"
    )
    other, _ = small_scan(tmp_path / "c", scanner=standard_rig(320, 180), steps=6, seed=6)
    np.testing.assert_array_equal(first.points, second.points)
    assert not np.array_equal(first.points, other.points)
