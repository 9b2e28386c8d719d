"""What the doctor names on simulated benches with each fault planted: python -m benchmarks.doctor"""

import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from app.checkup.checkup import checkup, chosen
from app.checkup.examination import Examination
from app.devices.bench import Bench
from app.devices.bench_file import simulated_description
from app.recording.manifest_facts import PlatterFacts

PLATTER = PlatterFacts(kind="aruco", dictionary="DICT_4X4_50", marker_mm=14.0, ids=tuple(range(8)))
PLANTED: dict[str, dict[str, Any]] = {
    **{f"nothing, seed {seed}": {"seed": seed} for seed in range(5)},
    "wrong direction": {"wrong_direction": True},
    "3150 steps per turn": {"steps_per_turn": 3150.0},
    "6400 steps per turn": {"steps_per_turn": 6400.0},
    "play of 0.5 degrees": {"play_deg": 0.5},
    "swapped lasers": {"swapped_lasers": True},
    "120 ms latency": {"camera_latency_s": 0.12},
    "120 ms latency, no times": {"camera_latency_s": 0.12, "has_timestamps": False},
    "two stale frames": {"stale_frames": 2},
    "saturated stripe": {"saturated": True},
}


def main() -> None:
    """One line for each fault: what was named, in how many seconds. At true speed, 720 rows."""
    for name, planted in PLANTED.items():
        if len(sys.argv) > 1 and not any(word in name for word in sys.argv[1:]):
            continue
        description = simulated_description(**planted).model_copy(update={"platter": PLATTER})
        with Bench.build(description) as bench, tempfile.TemporaryDirectory() as folder:
            bench.connect()
            began_s = time.monotonic()
            report = checkup(Examination(bench, Path(folder)), chosen([]))
            took_s = time.monotonic() - began_s
        named = "; ".join(f"{finding.check} {dict(finding.numbers)}" for finding in report.troubles)
        print(f"{name:26} {took_s:5.0f} s  {named or 'in order'}", flush=True)


if __name__ == "__main__":
    main()
