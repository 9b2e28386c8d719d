"""How fast recordings are simulated: 720p, both lasers and a texture frame at every stop, as by default."""

import tempfile
import time
from dataclasses import replace
from pathlib import Path

from app.recording.simulated import simulate_recording
from app.recording.simulated_plan import SimulationPlan
from app.simulation.objects import make_object
from benchmarks.report import Row, at_most

_STEPS, _FULL_STEPS = 30, 400
_WARM_STEPS = 2
_LIMIT_S = 60.0


def run() -> list[Row]:
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name in ("mug", "sphere"):
            scan = SimulationPlan(item=make_object(name, None), parts=("scan",), steps=_STEPS)
            # What is compiled and drawn once is not part of the pace.
            once_s = _seconds(replace(scan, steps=_WARM_STEPS), Path(folder) / f"{name}-warm")
            once_s = min(once_s, _seconds(replace(scan, steps=_WARM_STEPS), Path(folder) / f"{name}-short"))
            before_s = time.process_time()
            pace_s = (_seconds(scan, Path(folder) / name) - once_s) / (_STEPS - _WARM_STEPS)
            busy_s = (time.process_time() - before_s) * _FULL_STEPS / _STEPS
            calibration_s = _seconds(replace(scan, parts=("calibration",)), Path(folder) / f"{name}-boards")
            whole_s = once_s + pace_s * (_FULL_STEPS - _WARM_STEPS)
            rows += [
                Row(f"{name}: stops simulated", 1.0 / pace_s, "per second", note="three frames each"),
                at_most(
                    f"{name}: scan of {_FULL_STEPS} steps", whole_s, "s", _LIMIT_S,
                    f"1200 frames, from the pace of {_STEPS} steps",
                ),
                Row(f"{name}: processor time of that scan", busy_s, "s", note="all cores together"),
                at_most(
                    f"{name}: the same with its calibration views", whole_s + calibration_s, "s", _LIMIT_S
                ),
            ]  # fmt: skip
    return rows


def _seconds(plan: SimulationPlan, folder: Path) -> float:
    start = time.perf_counter()
    simulate_recording(folder, plan)
    return time.perf_counter() - start
