"""The whole journey at 720p30 in the bench's own time, through `turnscan serve` in a process of its own."""

import tempfile
from collections.abc import Callable
from pathlib import Path

from app.simulation.stage import Stage
from app.simulation.world_plan import WorldPlan
from benchmarks.journeys import Journey, by_client, by_requests
from benchmarks.report import Row, at_most
from benchmarks.served import served

_SCANS = {
    "step": {"steps": 100},
    "continuous": {"mode": "continuous", "seconds_per_turn": 30.0},
}
_LIMIT_MM = 0.1


def run() -> list[Row]:
    travels: dict[str, Callable[..., Journey]] = {"requests": by_requests, "client": by_client}
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name, travel in travels.items():
            place = Path(folder) / name
            place.mkdir()
            with served(place) as address:
                journey = travel(address, place, Stage(WorldPlan(object="sphere")), _SCANS)
            rows += _rows(name, journey)
    return rows


def _rows(name: str, journey: Journey) -> list[Row]:
    rows = [
        Row(f"{name}: calibration's expected error", 1e3 * journey.expected_mm, "um"),
        at_most(f"{name}: calibration's true error", 1e3 * journey.true_mm, "um RMS", 1e3 * _LIMIT_MM),
        Row(f"{name}: calibration", journey.calibrate_s, "s"),
    ]
    for mode, ball in journey.scans.items():
        note = f"{ball.points} points; {1e3 * ball.shape_mm:.1f} um where the ball lies by itself"
        rows.append(at_most(f"{name}: {mode} scan", 1e3 * ball.off_mm, "um RMS", 1e3 * _LIMIT_MM, note))
        rows.append(Row(f"{name}: {mode} scan, from order to download", ball.seconds, "s"))
    return rows
