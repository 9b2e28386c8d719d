"""Jobs: one at a time on the bench, paused, cancelled, and told about."""

import json
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from datetime import UTC, datetime, timedelta, tzinfo
from pathlib import Path
from typing import Any

import pytest

from app.errors import DeviceLost, DeviceRefused, JobRuns, NotNow, NotThere, OutputError
from app.jobs.events import EventBus, JobChanged, JobSaid, PointsAdded
from app.jobs.job import JobSnapshot, JobState
from app.jobs.pace import Pace
from app.jobs.runner import JobContext, JobRunner


@pytest.fixture
def bus() -> EventBus:
    return EventBus()


@pytest.fixture
def runner(tmp_path: Path, bus: EventBus) -> Iterator[JobRunner]:
    runner = JobRunner(tmp_path / "jobs", bus)
    yield runner
    runner.close(60.0)


def test_a_job_that_ends_well_keeps_its_result(runner: JobRunner, tmp_path: Path) -> None:
    job = runner.submit("add", "one and one", lambda job: {"sum": 2}, needs_bench=False)
    ended = _ended(runner, job.id)
    assert ended.state is JobState.DONE
    assert ended.result == {"sum": 2}
    assert json.loads((tmp_path / "jobs" / f"{job.id}.json").read_text())["result"] == {"sum": 2}


def test_an_expected_error_is_told_with_its_hint(runner: JobRunner) -> None:
    def work(job: JobContext) -> Mapping[str, Any]:
        raise DeviceLost("camera", "is gone")

    problem = _ended(runner, runner.submit("look", "look", work, needs_bench=True).id).problem
    assert problem is not None
    assert (problem.code, problem.message) == ("device-lost", "camera: is gone")
    assert problem.hint


def test_a_job_on_the_bench_waits_until_a_person_says_that_it_is_done(runner: JobRunner) -> None:
    def work(job: JobContext) -> Mapping[str, Any]:
        runner.ask_person("Turn the table to 30 degrees, then confirm.")
        return {"turned": 30}

    with pytest.raises(DeviceRefused, match="worked by hand"):
        runner.ask_person("Turn the table to 30 degrees, then confirm.")
    job = runner.submit("scan", "by hand", work, needs_bench=True)
    _wait(lambda: runner.job(job.id).asks)
    assert runner.job(job.id).waits_for == "Turn the table to 30 degrees, then confirm."
    with pytest.raises(DeviceRefused, match="worked by hand"):
        runner.ask_person("Whoever else moves the table does not have the job ask for it.")
    with pytest.raises(NotNow, match="does not ask"):
        runner.is_done_by_hand(job.id, "Turn the table to 20 degrees, then confirm.")
    runner.is_done_by_hand(job.id, runner.job(job.id).waits_for)
    ended = _ended(runner, job.id)
    assert (ended.result, ended.asks, ended.waits_for) == ({"turned": 30}, False, "")
    other = runner.submit("scan", "by hand", work, needs_bench=True)
    _wait(lambda: runner.job(other.id).asks)
    runner.cancel(other.id)
    assert _ended(runner, other.id).state is JobState.CANCELLED


def test_a_surprise_ends_the_job_with_its_traceback_in_the_log(runner: JobRunner) -> None:
    def work(job: JobContext) -> Mapping[str, Any]:
        raise ZeroDivisionError("oops")

    job = _ended(runner, runner.submit("divide", "divide", work, needs_bench=False).id)
    assert job.state is JobState.FAILED
    assert any("ZeroDivisionError" in line for line in runner.lines(job.id))


def test_one_job_holds_the_bench_and_computations_run_beside_it(runner: JobRunner) -> None:
    gate = threading.Event()
    first = runner.submit("scan", "first", _waiting(gate), needs_bench=True)
    second = runner.submit("scan", "second", _waiting(gate), needs_bench=True)
    beside = runner.submit("reconstruct", "beside", lambda job: {}, needs_bench=False)
    assert _ended(runner, beside.id).state is JobState.DONE
    assert runner.job(first.id).state is JobState.RUNNING
    assert runner.job(second.id).state is JobState.QUEUED
    gate.set()
    assert _ended(runner, second.id).state is JobState.DONE


def test_a_paused_job_rests_at_its_checkpoint_until_it_is_resumed(runner: JobRunner) -> None:
    steps: list[int] = []
    began = threading.Event()

    def work(job: JobContext) -> Mapping[str, Any]:
        for step in range(10_000):
            steps.append(step)
            began.set()
            time.sleep(0.001)
            job.checkpoint()
        return {}

    job = runner.submit("count", "count", work, needs_bench=True)
    assert began.wait(60.0)
    assert runner.pause(job.id).state is JobState.PAUSED
    _wait(lambda: _stands_still(steps))
    assert runner.resume(job.id).state is JobState.RUNNING
    count = len(steps)
    _wait(lambda: len(steps) > count)
    runner.pause(job.id)
    runner.cancel(job.id)
    assert _ended(runner, job.id).state is JobState.CANCELLED


def test_cancelling_calls_who_can_stop_what_is_under_way(runner: JobRunner) -> None:
    stopped, began = threading.Event(), threading.Event()

    def unplugged() -> None:
        raise DeviceLost("table", "is gone")

    def work(job: JobContext) -> Mapping[str, Any]:
        job.on_cancel(unplugged)
        job.on_cancel(stopped.set)
        began.set()
        assert stopped.wait(60.0)
        raise DeviceLost("table", "was stopped")

    job = runner.submit("turn", "turn", work, needs_bench=True)
    assert began.wait(60.0)
    runner.cancel(job.id)
    assert _ended(runner, job.id).state is JobState.CANCELLED


def test_a_job_that_waits_its_turn_can_be_cancelled(runner: JobRunner) -> None:
    gate = threading.Event()
    first = runner.submit("scan", "first", _waiting(gate), needs_bench=True)
    dropped = threading.Event()
    second = runner.submit("scan", "second", _waiting(gate), needs_bench=True, on_dropped=dropped.set)
    assert runner.cancel(second.id).state is JobState.CANCELLED
    assert dropped.is_set()
    gate.set()
    assert _ended(runner, first.id).state is JobState.DONE


def test_progress_foretells_the_time_that_is_left(runner: JobRunner) -> None:
    gate = threading.Event()

    def work(job: JobContext) -> Mapping[str, Any]:
        job.progress(0, 5, "none")
        time.sleep(0.02)
        job.progress(1, 5, "one")
        gate.wait(60.0)
        return {}

    job = runner.submit("count", "count", work, needs_bench=False)
    _wait(lambda: runner.job(job.id).done == 1)
    left = runner.job(job.id).seconds_left
    assert left is not None
    assert left >= 0.08
    gate.set()


def test_a_slow_listener_hears_the_newest_state_and_the_last_lines(bus: EventBus, runner: JobRunner) -> None:
    with bus.listen() as listener:

        def work(job: JobContext) -> Mapping[str, Any]:
            for number in range(1000):
                job.progress(number, 1000)
                job.say(f"line {number}")
                bus.publish(PointsAdded(job.id, number))
            return {}

        job = runner.submit("talk", "talk", work, needs_bench=False)
        _ended(runner, job.id)
        heard = []
        while (event := listener.next(0.0)) is not None:
            heard.append(event)
    lines = [event.line for event in heard if isinstance(event, JobSaid)]
    states = [event.job for event in heard if isinstance(event, JobChanged)]
    assert lines[-1] == "line 999"
    assert len(lines) + listener.lost == 1000
    assert [job.state for job in states] == [JobState.DONE]
    assert [event.points for event in heard if isinstance(event, PointsAdded)] == [999]


def test_an_unknown_job_is_not_there(runner: JobRunner) -> None:
    with pytest.raises(NotThere, match="no job 'x'"):
        runner.job("x")


def test_a_job_that_waits_says_for_what(runner: JobRunner) -> None:
    gate = threading.Event()
    runner.submit("scan", "a mug", _waiting(gate), needs_bench=True)
    second = runner.submit("scan", "a bowl", _waiting(gate), needs_bench=True)
    assert runner.job(second.id).waits_for == "the bench, which 'a mug' has"
    gate.set()
    assert _ended(runner, second.id).waits_for == ""


def test_jobs_are_there_again_in_the_next_run_and_broken_ones_are_passed_over(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = tmp_path / "jobs"
    gate = threading.Event()
    first = JobRunner(folder, EventBus())
    talk = first.submit("talk", "ten thousand lines", _talking(10_000), needs_bench=False)
    _wait(lambda: first.job(talk.id).state.has_ended, 60.0)
    order = {"scan": "mug", "steps": 12}
    cut = first.submit("scan", "a mug", _waiting(gate), needs_bench=True, scan="mug", order=order)
    late = first.submit("scan", "a bowl", _waiting(gate), needs_bench=True)
    # Another program that looks now finds what a power cut would leave.
    (folder / "20260101T000000-abcdef.json").write_text('{"id": "20260101T0')
    (folder / "20260101T000000-abcdee.json").write_bytes(b"\xff\x00")
    second = JobRunner(folder, EventBus(), is_unfinished=lambda scan: scan == "mug")
    assert [job.id for job in second.jobs()] == [late.id, cut.id, talk.id]
    problem = second.job(cut.id).problem
    assert problem is not None
    assert problem.code == "interrupted"
    assert (second.job(cut.id).state, second.job(cut.id).can_resume) == (JobState.FAILED, True)
    assert second.job(cut.id).order == order
    assert (second.job(talk.id).state, second.job(late.id).can_resume) == (JobState.DONE, False)
    assert len(second.lines(talk.id)) == 10_000
    assert caplog.text.count("is left out") == 2
    gate.set()
    first.close(60.0)


def test_jobs_can_be_taken_off_the_list_once_they_have_ended(runner: JobRunner, tmp_path: Path) -> None:
    gate = threading.Event()
    job = runner.submit("scan", "a mug", _waiting(gate), needs_bench=True)
    with pytest.raises(JobRuns, match="has not ended"):
        runner.forget(job.id)
    gate.set()
    _ended(runner, job.id)
    runner.forget(job.id)
    assert runner.jobs() == []
    assert list((tmp_path / "jobs").iterdir()) == []


def test_old_jobs_make_room_and_a_clock_that_jumps_back_mixes_nothing_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    runner = JobRunner(tmp_path / "jobs", EventBus())
    ids = []
    for number in range(205):
        now = datetime(2026, 11, 21, tzinfo=UTC) - timedelta(hours=number)
        monkeypatch.setattr("app.jobs.runner.datetime", _clock_at(now))
        job = runner.submit("add", "one", lambda job: {}, needs_bench=False)
        _ended(runner, job.id)
        ids.append(job.id)
    runner.close(60.0)
    assert [job.id for job in JobRunner(tmp_path / "jobs", EventBus()).jobs()] == ids[:4:-1]


def test_a_full_disk_takes_no_job_down(
    runner: JobRunner, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def full(path: Path, data: bytes, *, is_durable: bool = True) -> None:
        raise OutputError(str(path), "no space left on device")

    monkeypatch.setattr("app.jobs.archive.write_whole", full)
    job = runner.submit("talk", "talk", _talking(3), needs_bench=False)
    assert _ended(runner, job.id).state is JobState.DONE
    assert caplog.text.count("no space left on device") == 1


def test_time_left_begins_as_expected_and_follows_what_is_measured() -> None:
    pace = Pace(100.0)
    assert pace.left_s(0.0, 0, 100) == 100.0
    assert pace.left_s(0.2, 1, 100) == pytest.approx(99.0 * (1 - 1 / 15) + 19.8 / 15)
    for done in range(2, 51):
        left = pace.left_s(0.2 * done, done, 100)
    assert left == pytest.approx(10.0)
    # What follows is another part, and nothing is known of it yet.
    assert pace.left_s(11.0, 0, 40) is None
    resumed = Pace()
    assert resumed.left_s(0.0, 60, 100) is None
    assert resumed.left_s(2.0, 61, 100) == pytest.approx(78.0)


class _Clock(datetime):
    """A system clock that stands."""

    stands_at: datetime

    @classmethod
    def now(cls, tz: tzinfo | None = None) -> datetime:  # type: ignore[override]
        return cls.stands_at


def _clock_at(moment: datetime) -> type[_Clock]:
    return type("_Stopped", (_Clock,), {"stands_at": moment})


def _talking(lines: int) -> "Callable[[JobContext], Mapping[str, Any]]":
    def work(job: JobContext) -> Mapping[str, Any]:
        for number in range(lines):
            job.say(f"line {number}")
        return {}

    return work


def _waiting(gate: threading.Event) -> "Callable[[JobContext], Mapping[str, Any]]":
    def work(job: JobContext) -> Mapping[str, Any]:
        assert gate.wait(60.0)
        return {}

    return work


def _ended(runner: JobRunner, job_id: str) -> JobSnapshot:
    _wait(lambda: runner.job(job_id).state.has_ended)
    return runner.job(job_id)


def _stands_still(steps: list[int]) -> bool:
    count = len(steps)
    time.sleep(0.05)
    return len(steps) == count


def _wait(is_so: Callable[[], bool], timeout_s: float = 60.0) -> None:
    ends = time.monotonic() + timeout_s
    while not is_so():
        assert time.monotonic() < ends, "it never came to be"
        time.sleep(0.002)
