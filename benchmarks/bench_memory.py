"""Does a scan of four times the frames take more memory?"""

import json
import sys
import tempfile
from pathlib import Path

import numpy as np

from app.recording.reader import Recording
from app.recording.simulated import simulate_recording
from app.recording.simulated_plan import SimulationPlan
from app.scanning.sources import reconstruct_recording, scan_detector
from app.simulation.rig import standard_rig
from app.surface.ply import PlyWriter
from app.surface.preview import PreviewPainter
from benchmarks.peak_memory import own_peak_mb, peak_mb_of
from benchmarks.report import Row, at_most

# With fewer stops the samples for the preview and for comparing lasers are not yet full.
_FEW, _MANY = 300, 1200
_SIZE = (640, 360)
_PREVIEW_POINTS = 100_000


def run() -> list[Row]:
    with tempfile.TemporaryDirectory() as folder:
        few, many = (_peak_mb(Path(folder), stops) for stops in (_FEW, _MANY))
    note = "scan to PLY and preview, 640 x 360, three frames a stop"
    return [
        Row(f"peak memory, {_FEW} stops", few, "MB", note=note),
        Row(f"peak memory, {_MANY} stops", many, "MB", note=note),
        at_most("growth for four times the frames", many / few, "times", 1.05),
    ]


def _peak_mb(folder: Path, stops: int) -> float:
    recording = folder / f"scan-{stops}"
    _long_recording(recording, stops)
    return peak_mb_of("benchmarks.bench_memory", str(recording))


def _long_recording(folder: Path, stops: int) -> None:
    """The frames of one stop again and again, at other angles and under other names."""
    plan = SimulationPlan(scanner=standard_rig(*_SIZE), parts=("scan",), steps=1, image_format="jpeg")
    simulate_recording(folder, plan)
    manifest = json.loads((folder / "recording.json").read_text())
    once = manifest["frames"]
    manifest["frames"] = []
    for k, angle in enumerate(np.arange(stops) * 360.0 / stops):
        for frame in once:
            file = f"{frame['file'].removesuffix('.jpg')}-{k}.jpg"
            (folder / file).hardlink_to(folder / frame["file"])
            manifest["frames"].append({**frame, "file": file, "angle_deg": float(angle), "time_s": float(k)})
    (folder / "recording.json").write_text(json.dumps(manifest))


def _reconstruct(folder: Path) -> None:
    run = reconstruct_recording(Recording.open(folder), standard_rig(*_SIZE).rig, scan_detector())
    painter = PreviewPainter(_PREVIEW_POINTS)
    with PlyWriter(folder / "cloud.ply", run.laser_names) as writer:
        for profile in run:
            writer.append(profile.cloud)
            painter.add(profile.cloud)
    run.report()
    painter.write(folder / "cloud.png")


if __name__ == "__main__":
    _reconstruct(Path(sys.argv[1]))
    print(own_peak_mb())
