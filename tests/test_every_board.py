"""`turnscan scan` through a pseudo-terminal, with every board in turn, gives the same cloud."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from app.devices.bench import Bench
from app.devices.bench_file import simulated_description
from app.recording.manifest import FrameEntry
from app.scanning.plan import ScanPlan
from app.scanning.run import run_scan
from app.scanning.scan import Taken
from app.scanning.session import ScanSession
from app.scanning.sources import reconstruct_recording, scan_detector
from app.simulation.firmware.kernel import FIRMWARES

# Boards whose table turns in whole degrees, or in coarse steps, stop elsewhere; the cloud is the same.
_STEPS = 12
_RADIUS_MM = 30.0


class _Nobody:
    def taken(self, taken: Taken, entry: FrameEntry) -> None: ...
    def waiting(self, problem: str) -> None:
        raise AssertionError(problem)

    def going_on(self) -> None: ...


@pytest.mark.parametrize("dialect", sorted(FIRMWARES))
def test_the_ball_is_the_same_with_every_board(dialect: str, tmp_path: Path) -> None:
    described = simulated_description(dialect, object="sphere", width=640, height=480, rate=20.0)
    with Bench.build(described) as bench:
        bench.connect()
        assert bench.world is not None
        plan = ScanPlan(lasers=tuple(bench.lasers), steps=_STEPS)
        session = ScanSession.create(tmp_path / "scan", plan, bench, "simulated")
        recording = run_scan(bench, session, _Nobody())
        rig = bench.world.rig
    run = reconstruct_recording(recording, rig, scan_detector())
    points = np.concatenate([profile.cloud.points for profile in run]).astype(np.float64)
    ball = points[points[:, 2] > 8.0]
    middle, radius = _sphere(ball)
    off = np.linalg.norm(ball - middle, axis=1) - radius
    assert radius == pytest.approx(_RADIUS_MM, abs=0.06)
    assert float(np.sqrt(np.mean(off**2))) < 0.12
    # It stands where every other board saw it.
    assert middle == pytest.approx([5.25, -3.0, 30.0], abs=0.15)


def _sphere(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Middle and radius by linear least squares."""
    design = np.column_stack([2.0 * points, np.ones(len(points))])
    solution, *_ = np.linalg.lstsq(design, (points**2).sum(axis=1), rcond=None)
    middle = solution[:3]
    return middle, float(np.sqrt(solution[3] + middle @ middle))
