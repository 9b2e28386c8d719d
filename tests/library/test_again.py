"""A scan of the library, computed again."""

import json
import os
import shutil
from pathlib import Path

import pytest
from small_library import left_over

from app.calibration.record import CalibrationRecord
from app.errors import LibraryError, OptionError, OutputError, ScanNotFound
from app.library.again import reconstruct_again
from app.library.library import Library
from app.scanning.reconstruct import ReconstructionOptions
from app.surface.ply_reader import read_ply


@pytest.fixture
def library(small_recording: Path, tmp_path: Path) -> Library:
    """With a scan of a ball; its pictures are links."""
    shutil.copytree(small_recording, tmp_path / "scans" / "ball", copy_function=os.link)
    return Library(tmp_path / "scans")


@pytest.fixture
def truth(library: Library) -> CalibrationRecord:
    return CalibrationRecord.load(library.folder / "ball" / "truth.json")


def test_each_time_there_is_one_more_cloud_that_says_how_it_was_made(
    library: Library, truth: CalibrationRecord
) -> None:
    truth.save(library.folder / "ball" / "calibration.json")
    told: list[tuple[int, int, int]] = []
    first = reconstruct_again(library, "ball", progress=lambda *numbers: told.append(numbers))
    options = ReconstructionOptions(above_mm=5.0, radius_mm=float("inf"))
    second = reconstruct_again(library, "ball", truth, "centroid", options)
    item = library.scan("ball")
    assert item.clouds == (first.cloud, second.cloud)
    assert told[-1] == (24, 24, first.cloud.points)
    assert item.points == second.cloud.points < first.cloud.points
    assert item.thumbnail == item.folder / second.cloud.picture
    assert second.cloud.detector == "centroid"
    assert second.cloud.calibrated == truth.created
    cloud = read_ply(item.folder / second.cloud.name)
    assert len(cloud) == second.report.points == second.cloud.points
    assert cloud.points[:, 2].min() >= 5.0
    how = json.loads((item.folder / second.cloud.name).with_suffix(".json").read_text())
    assert how["options"]["above_mm"] == 5.0
    assert how["options"]["radius_mm"] == "inf"
    kept = CalibrationRecord.parse(json.dumps(how["calibration"]).encode(), "the cloud")
    assert kept.to_bytes() == truth.to_bytes()
    assert left_over(library) == []


def test_a_scan_without_a_calibration_says_so(library: Library) -> None:
    with pytest.raises(LibraryError, match="no calibration of its own"):
        reconstruct_again(library, "ball")


def test_nothing_is_written_when_it_fails(library: Library, truth: CalibrationRecord) -> None:
    before = library.scan("ball")
    with pytest.raises(OptionError, match="detector"):
        reconstruct_again(library, "ball", truth, "guessing")
    with pytest.raises(ScanNotFound):
        reconstruct_again(library, "../ball", truth)

    def stop(done: int, total: int, points: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        reconstruct_again(library, "ball", truth, progress=stop)
    assert library.scan("ball") == before
    assert left_over(library) == []


def test_a_scan_that_is_deleted_meanwhile_stays_deleted(library: Library, truth: CalibrationRecord) -> None:
    def delete(done: int, total: int, points: int) -> None:
        if done == total:
            library.delete("ball")

    with pytest.raises(ScanNotFound):
        reconstruct_again(library, "ball", truth, progress=delete)
    assert library.scans() == ()
    assert library.restore("ball").clouds == ()


@pytest.mark.parametrize("which", [1, 2, 3])
def test_a_cloud_is_there_with_the_last_of_its_files(
    which: int, library: Library, truth: CalibrationRecord, monkeypatch: pytest.MonkeyPatch
) -> None:
    renamed = 0
    replace = os.replace

    def fail(source: Path, to: Path) -> None:
        nonlocal renamed
        renamed += Path(to).parent.name == "clouds"
        if renamed == which:
            raise OSError(5, "Input/output error")
        replace(source, to)

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(OutputError, match="input/output"):
        reconstruct_again(library, "ball", truth)
    monkeypatch.undo()
    assert library.scan("ball").clouds == ()
    assert left_over(library) == []
    assert reconstruct_again(library, "ball", truth).cloud.points > 1000
