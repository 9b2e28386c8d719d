import dataclasses
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from small_scans import SmallScan, make_small_scan

from app.errors import FrameError, ReconstructionError
from app.geometry.camera import CameraIntrinsics
from app.recording.reader import Recording
from app.scanning.reconstruct import Reconstruction, ReconstructionOptions
from app.scanning.sources import reconstruct_recording, scan_detector

STOPS = 4


@pytest.fixture(scope="session")
def small_scan(tmp_path_factory: pytest.TempPathFactory) -> SmallScan:
    return make_small_scan(tmp_path_factory.getbasetemp())


def altered(scan: SmallScan, folder: Path, change: Callable[[Path, dict[str, Any]], None]) -> Recording:
    """A copy of the first stops, changed on disk."""
    copy = folder / "copy"
    shutil.copytree(scan.recording.folder, copy)
    manifest = json.loads((copy / "recording.json").read_text())
    manifest["frames"] = manifest["frames"][: 3 * STOPS]
    change(copy, manifest)
    (copy / "recording.json").write_text(json.dumps(manifest))
    return Recording.open(copy)


def rebuild(scan: SmallScan, recording: Recording, **options: Any) -> Reconstruction[Any]:
    chosen = ReconstructionOptions(uses_markers=False, **options)
    return reconstruct_recording(recording, scan.plan.scanner.rig, scan_detector(), chosen)


def test_a_calibration_for_another_picture_size_names_both(small_scan: SmallScan) -> None:
    rig = small_scan.plan.scanner.rig
    other = dataclasses.replace(
        rig, camera=CameraIntrinsics(rig.camera.matrix, rig.camera.distortion, (640, 480))
    )
    with pytest.raises(ReconstructionError, match=r"480 x 270.*640 x 480"):
        reconstruct_recording(small_scan.recording, other, scan_detector())


def test_a_laser_that_the_calibration_does_not_know_is_named(small_scan: SmallScan) -> None:
    rig = small_scan.plan.scanner.rig
    other = dataclasses.replace(rig, lasers={"left": rig.lasers["left"]})
    with pytest.raises(ReconstructionError, match="no laser 'right'; it knows 'left'"):
        reconstruct_recording(small_scan.recording, other, scan_detector())


def test_a_laser_that_is_never_seen_is_named(small_scan: SmallScan, tmp_path: Path) -> None:
    def darken(folder: Path, manifest: dict[str, Any]) -> None:
        for frame in manifest["frames"]:
            if frame["lasers_on"] == ["right"]:
                cv2.imwrite(str(folder / frame["file"]), np.zeros((270, 480, 3), np.uint8))

    with pytest.raises(ReconstructionError, match=r"Laser 'right' is lit .* never seen"):
        list(rebuild(small_scan, altered(small_scan, tmp_path, darken)))


def test_a_frame_without_an_angle_is_named(small_scan: SmallScan, tmp_path: Path) -> None:
    def forget(_: Path, manifest: dict[str, Any]) -> None:
        del manifest["frames"][4]["angle_deg"]

    recording = altered(small_scan, tmp_path, forget)
    with pytest.raises(ReconstructionError, match=f"{recording.entries[4].file} has no table angle"):
        rebuild(small_scan, recording)


def test_a_frame_cut_short_ends_the_run_or_is_skipped(small_scan: SmallScan, tmp_path: Path) -> None:
    def cut(folder: Path, manifest: dict[str, Any]) -> None:
        file = folder / manifest["frames"][4]["file"]
        file.write_bytes(file.read_bytes()[:500])

    recording = altered(small_scan, tmp_path, cut)
    name = recording.entries[4].file
    with pytest.raises(FrameError, match=name):
        list(rebuild(small_scan, recording))
    run = rebuild(small_scan, recording, skips_bad_frames=True)
    assert {profile.number for profile in run} == {0, 2, 3}
    report = run.report()
    assert name in report.skipped[0].name
    assert any(name in warning for warning in report.warnings)


def test_a_region_beside_everything_is_an_error(small_scan: SmallScan) -> None:
    with pytest.raises(ReconstructionError, match="None of the"):
        list(rebuild(small_scan, small_scan.recording, above_mm=200.0))


def test_a_recording_without_scan_frames_is_named(small_scan: SmallScan, tmp_path: Path) -> None:
    def no_lasers(_: Path, manifest: dict[str, Any]) -> None:
        manifest["frames"] = [frame for frame in manifest["frames"] if not frame["lasers_on"]]

    recording = altered(small_scan, tmp_path, no_lasers)
    with pytest.raises(ReconstructionError, match="no scan frame"):
        rebuild(small_scan, recording)
