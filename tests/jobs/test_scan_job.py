"""Scans, checkups and reconstructions as jobs on the simulated bench."""

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from app.calibration.record import CalibrationRecord
from app.devices.bench import Bench
from app.devices.bench_file import BenchDescription, simulated_description
from app.jobs.events import EventBus
from app.jobs.job import JobSnapshot, JobState
from app.jobs.recipes import ScanOrder, checkup_work, reconstruct_work, scan_work
from app.jobs.runner import JobRunner
from app.library.library import Library
from app.library.log import read_log
from app.recording.reader import Recording
from app.scanning.plan import ScanPlan


@pytest.fixture
def runner(tmp_path: Path) -> Iterator[JobRunner]:
    runner = JobRunner(tmp_path / "jobs", EventBus())
    yield runner
    runner.close(10.0)


@pytest.fixture
def bench() -> Iterator[Bench]:
    with Bench.build(_described(20.0)) as bench:
        yield bench


@pytest.fixture
def record(bench: Bench) -> CalibrationRecord:
    assert bench.world is not None
    rig = bench.world.rig
    return CalibrationRecord(camera=rig.camera, lasers=rig.lasers, axis=rig.axis)


def test_a_scan_job_ends_with_a_cloud(
    runner: JobRunner, bench: Bench, record: CalibrationRecord, tmp_path: Path
) -> None:
    points: list[int] = []
    library = Library(tmp_path / "scans")
    folder = library.reserve("A ball")
    order = ScanOrder(folder, ScanPlan(lasers=("left",), steps=12), "simulated")
    work = scan_work(bench, order, record, lambda profile: points.append(len(profile)))
    job = _ended(runner, runner.submit("scan", "a ball", work, needs_bench=True).id)
    assert job.state is JobState.DONE, job.problem
    assert job.result["pictures"] == 24
    assert job.result["points"] > 500
    assert (folder / "cloud.ply").is_file()
    assert sum(points) > 500
    begun, taken, computed = read_log(folder)
    assert "12 stops in 360 degrees, 24 pictures, lasers left." in begun
    assert "Calibration: the calibration, of " in begun
    assert "All pictures are taken: 24" in taken
    assert f"Computed cloud.ply with zero-crossing: {job.result['points']} points." in computed
    again = reconstruct_work(library, folder.name, record)
    job = _ended(runner, runner.submit("reconstruct", "again", again, needs_bench=False).id)
    assert job.state is JobState.DONE, job.problem
    assert len(library.scan(folder.name).clouds) == 2


_STEPS = ScanPlan(lasers=("left",), steps=60)
_TURN = ScanPlan(mode="continuous", lasers=("left",), seconds_per_turn=6.0, turn_deg=90.0, with_dark=False)


@pytest.mark.parametrize(("plan", "rate"), [(_STEPS, 20.0), (_TURN, 1.0)], ids=["step", "continuous"])
def test_a_scan_can_rest_and_go_on_and_be_cancelled(
    runner: JobRunner, tmp_path: Path, plan: ScanPlan, rate: float
) -> None:
    folder = tmp_path / "scan"
    with Bench.build(_described(rate)) as bench:
        work = scan_work(bench, ScanOrder(folder, plan, "simulated"), None)
        job = runner.submit("scan", "a ball", work, needs_bench=True)
        _wait(lambda: runner.job(job.id).done > 5)
        runner.pause(job.id)
        _wait(lambda: _rests(folder) and _is_dark(bench))
        seen = len(Recording.open(folder).entries)
        runner.resume(job.id)
        _wait(lambda: len(Recording.open(folder).entries) > seen)
        runner.cancel(job.id)
        assert _ended(runner, job.id).state is JobState.CANCELLED
        assert _is_dark(bench)
        assert len(Recording.open(folder).entries) > seen
    told = " ".join(read_log(folder))
    words = [
        "Scan begun",
        "Calibration: none",
        "Was paused for" if plan.mode == "step" else "The scan goes on",
    ]
    for each in (*words, "Ended early with"):
        assert each in told


def test_a_scan_that_is_gone_on_with_keeps_its_calibration(
    runner: JobRunner, bench: Bench, record: CalibrationRecord, tmp_path: Path
) -> None:
    folder = tmp_path / "scan"

    def ended(plan: ScanPlan | None, calibration: CalibrationRecord, *, is_cancelled: bool) -> JobSnapshot:
        work = scan_work(bench, ScanOrder(folder, plan, "simulated"), calibration)
        job = runner.submit("scan", "a ball", work, needs_bench=True)
        if is_cancelled:
            _wait(lambda: runner.job(job.id).done > 2)
            runner.cancel(job.id)
        return _ended(runner, job.id)

    assert ended(_STEPS, record, is_cancelled=True).state is JobState.CANCELLED
    job = ended(None, replace(record, lasers={}, axis=None), is_cancelled=False)
    assert job.state is JobState.DONE, job.problem
    assert job.result["points"] > 500
    assert CalibrationRecord.load(folder / "calibration.json").lasers


def test_a_checkup_job_reports(runner: JobRunner, bench: Bench, tmp_path: Path) -> None:
    work = checkup_work(bench, ["board"], tmp_path, None)
    job = _ended(runner, runner.submit("checkup", "the doctor", work, needs_bench=True).id)
    assert job.state is JobState.DONE, job.problem
    assert job.result["findings"]


def _described(rate: float) -> BenchDescription:
    return simulated_description("horus", object="sphere", width=320, height=240, rate=rate)


def _is_dark(bench: Bench) -> bool:
    assert bench.world is not None
    return not bench.world.plant.at(bench.world.clock.now_s()).outputs_on


def _rests(folder: Path) -> bool:
    count = len(list((folder / "frames").iterdir()))
    time.sleep(0.3)
    return len(list((folder / "frames").iterdir())) == count


def _ended(runner: JobRunner, job_id: str) -> JobSnapshot:
    _wait(lambda: runner.job(job_id).state.has_ended)
    return runner.job(job_id)


def _wait(is_so: Callable[[], bool], timeout_s: float = 60.0) -> None:
    ends = time.monotonic() + timeout_s
    while not is_so():
        assert time.monotonic() < ends, "it never came to be"
        time.sleep(0.005)
