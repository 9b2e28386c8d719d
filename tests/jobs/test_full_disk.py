"""A disk that fills up under a scan, or may not be written, on a true file system of a few kilobytes."""

import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from app.devices.bench import Bench
from app.devices.bench_file import simulated_description
from app.jobs.events import EventBus
from app.jobs.job import JobSnapshot
from app.jobs.recipes import ScanOrder, scan_work
from app.jobs.runner import JobRunner
from app.recording.reader import Recording
from app.scanning.plan import ScanPlan


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    disk = tmp_path / "disk"
    disk.mkdir()
    if shutil.which("mount") is None or _mount("-t", "tmpfs", "-o", "size=256k", "tmpfs", disk):
        pytest.skip("this user may not mount a file system")
    yield disk
    subprocess.run(["umount", "-l", str(disk)], check=True)


def test_a_scan_on_a_disk_that_fills_up_goes_on_once_there_is_room(tmp_path: Path, small_disk: Path) -> None:
    folder = small_disk / "scan"
    plan = ScanPlan(lasers=("left",), steps=30)
    description = simulated_description("horus", object="sphere", width=320, height=240, rate=20.0)
    # Its own records lie on the full disk, too.
    runner = JobRunner(small_disk / "jobs", EventBus())
    with Bench.build(description) as bench:
        try:
            assert not _mount("-o", "remount,ro", small_disk)
            refused = _scanned(runner, bench, ScanOrder(folder, plan, "simulated"))
            assert refused.problem is not None
            assert (refused.problem.code, "read-only" in refused.problem.message) == ("output", True)
            assert not _mount("-o", "remount,rw", small_disk)
            broken = _scanned(runner, bench, ScanOrder(folder, plan, "simulated"))
            assert broken.problem is not None
            assert (broken.problem.code, "no space left" in broken.problem.message) == ("output", True)
            assert "go on with the scan" in broken.problem.hint
            kept = Recording.open(folder)
            assert 0 < len(kept.entries) < plan.shots
            assert all(kept.load(entry).image.size for entry in kept.entries)
            assert not _mount("-o", "remount,size=32m", small_disk)
            done = _scanned(runner, bench, ScanOrder(folder, None, "simulated"))
            assert done.result["pictures"] == plan.shots, done.problem
        finally:
            runner.close(60.0)
    recording = Recording.open(folder)
    assert len({(entry.unknown["stop"], entry.unknown["look"]) for entry in recording.entries}) == plan.shots


def _scanned(runner: JobRunner, bench: Bench, order: ScanOrder) -> JobSnapshot:
    job = runner.submit("scan", "a ball", scan_work(bench, order, None), needs_bench=True)
    ends = time.monotonic() + 180.0
    while not runner.job(job.id).state.has_ended:
        assert time.monotonic() < ends, "it never came to an end"
        time.sleep(0.01)
    return runner.job(job.id)


def _mount(*words: object) -> int:
    return subprocess.run(["mount", *map(str, words)], capture_output=True, check=False).returncode
