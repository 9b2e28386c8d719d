"""A small scan that is made once for all tests of this folder."""

from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np

from app.geometry.cloud import PointCloud
from app.recording.reader import Recording
from app.recording.simulated import simulate_recording
from app.recording.simulated_plan import AngleError, SimulationPlan
from app.scanning.profile import Profile
from app.scanning.report import ReconstructionReport
from app.scanning.sources import reconstruct_recording, scan_detector
from app.simulation.rig import standard_rig
from app.vision.markers import PlatterSpec


@dataclass(frozen=True, eq=False)
class SmallScan:
    """A ball of 60 mm on a table with markers, 40 stops; the motor loses a step of 1.5 degrees."""

    plan: SimulationPlan
    recording: Recording
    centre: np.ndarray
    lost_deg: float = 1.5
    profiles: list[Profile] = field(default_factory=list)
    reports: list[ReconstructionReport] = field(default_factory=list)

    def off(self, cloud: PointCloud) -> np.ndarray:
        """Distance of the ball's points from its surface, mm."""
        ball = cloud.points[cloud.points[:, 2] > 2.0]
        distance: np.ndarray = np.linalg.norm(ball - self.centre, axis=1) - 30.0
        return distance


@cache
def make_small_scan(folder: Path) -> SmallScan:
    """The scan in a new folder below this one; made once, whoever asks."""
    plan = SimulationPlan(
        scanner=standard_rig(480, 270, stripe_sigma_px=1.2),
        parts=("scan",),
        steps=40,
        platter=PlatterSpec("DICT_4X4_50", 20.0, (0, 1, 2, 3)),
        angle_error=AngleError(0.02, 1, 1.5),
    )
    recording = simulate_recording(folder / "small-scan", plan)
    scan = SmallScan(plan, recording, plan.table_from_item.translation + np.array([0.0, 0.0, 30.0]))
    run = reconstruct_recording(recording, plan.scanner.rig, scan_detector())
    scan.profiles.extend(run)
    scan.reports.append(run.report())
    return scan
