"""Compiles the kernels into the cache beside them, so that no test waits for it and no two do it at once.

`make test` runs it beside the checks, which need one core. It takes about 40 s; where all is compiled, four.
"""

import tempfile
from pathlib import Path

from app.recording.simulated import simulate_recording
from app.recording.simulated_plan import SimulationPlan, Views
from app.scanning.sources import reconstruct_recording, scan_detector
from app.simulation.rig import standard_rig


def main() -> None:
    """Take every kind of picture, and find the stripes in them."""
    views = Views(intrinsics=8, laser_plane=4, placements=2, angles_deg=(-24.0, 0.0, 24.0), axis_line=1)
    plan = SimulationPlan(scanner=standard_rig(320, 240), views=views, steps=6, texture_every=4)
    with tempfile.TemporaryDirectory() as folder:
        recording = simulate_recording(Path(folder) / "kernels", plan)
        for _ in reconstruct_recording(recording, plan.scanner.rig, scan_detector()):
            pass


if __name__ == "__main__":
    main()
