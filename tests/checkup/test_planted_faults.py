"""The doctor names each planted fault, that one alone, and none on a healthy bench."""

import re
from pathlib import Path
from typing import Any

import pytest
from sick_benches import BOARD, described, measured, named, report_of, true_calibration

from app.checkup.examination import Examination
from app.checkup.finding import State
from app.devices.turntable import Turntable

# All but the timing of the camera, which takes longest and has tests of its own.
STILL_AND_TURNING = ("board", "lasers", "picture", "turntable")
REAL_TIME: dict[str, Any] = {"rate": 1.0, "width": 320, "height": 180}


@pytest.mark.parametrize("seed", range(2))
def test_a_healthy_bench_gives_no_alarm(seed: int, tmp_path: Path) -> None:
    thing = ("mug", "sphere", "cone", "cylinder", "rabbit")[seed]
    report = report_of(described(seed=seed, object=thing), tmp_path, STILL_AND_TURNING)

    assert not report.troubles
    assert all(finding.state is State.OK for finding in report.findings)


def test_a_motor_wired_the_other_way_round_is_named(tmp_path: Path) -> None:
    report = report_of(described(wrong_direction=True), tmp_path, STILL_AND_TURNING)

    assert list(named(report)) == ["turntable.direction"]
    assert "wrong direction" in report.troubles[0].sentence
    assert 'direction = "cw"' in report.troubles[0].advice


def test_the_bench_file_may_say_that_the_table_turns_clockwise(tmp_path: Path) -> None:
    plain = described(wrong_direction=True)
    turntable = plain.turntable.model_copy(update={"direction": "cw"})
    report = report_of(plain.model_copy(update={"turntable": turntable}), tmp_path, ["turntable"])

    assert not report.troubles


@pytest.mark.parametrize("true_steps", [6400.0, 3190.0])
def test_wrong_steps_per_turn_are_named_with_the_right_ones(true_steps: float, tmp_path: Path) -> None:
    report = report_of(described(steps_per_turn=true_steps), tmp_path, STILL_AND_TURNING)

    assert list(named(report)) == ["turntable.steps"]
    told = re.search(r"3200 becomes (\d+)", report.troubles[0].advice)
    assert told is not None
    assert float(told[1]) == pytest.approx(true_steps, abs=3.0)
    turned = measured(report, "turntable.steps", "turned_for_360_deg")
    assert turned == pytest.approx(360.0 * 3200.0 / true_steps, rel=3e-4)


def test_play_is_named_with_its_size(tmp_path: Path) -> None:
    report = report_of(described(play_deg=0.8), tmp_path, STILL_AND_TURNING)

    assert list(named(report)) == ["turntable.play"]
    assert measured(report, "turntable.play", "play_deg") == pytest.approx(0.8, abs=0.1)


def test_lost_steps_are_named_with_their_size(tmp_path: Path) -> None:
    def weaken(exam: Examination) -> None:
        exam.bench.turntable = _SlippingTable(exam)  # type: ignore[assignment]

    report = report_of(described(), tmp_path, STILL_AND_TURNING, weaken)

    assert list(named(report)) == ["turntable.lost-steps"]
    # Four long moves up, each of which loses a quarter of a degree.
    assert measured(report, "turntable.lost-steps", "lost_deg") == pytest.approx(1.0, abs=0.1)


def test_swapped_lasers_are_named(tmp_path: Path) -> None:
    report = report_of(described(swapped_lasers=True), tmp_path, STILL_AND_TURNING)

    assert list(named(report)) == ["lasers.which"]
    assert "swapped" in report.troubles[0].sentence
    assert "left gets channel = 2" in report.troubles[0].advice


def test_swapped_lasers_are_known_by_their_calibrated_planes(tmp_path: Path) -> None:
    def calibrate(exam: Examination) -> None:
        exam.calibration = true_calibration(exam)

    report = report_of(described(swapped_lasers=True), tmp_path, ["lasers"], calibrate)
    well = report_of(described(), tmp_path, ["lasers"], calibrate)

    assert "calibrated plane" in named(report)["lasers.which"].sentence
    assert not well.troubles


def test_a_saturated_stripe_is_named_with_an_exposure_that_is_not(tmp_path: Path) -> None:
    report = report_of(described(saturated=True), tmp_path, STILL_AND_TURNING)

    assert set(named(report)) == {"picture.saturation.left", "picture.saturation.right"}
    assert all("Write exposure = " in finding.advice for finding in report.troubles)


def test_a_board_on_the_table_tells_as_much_as_markers(tmp_path: Path) -> None:
    plain = described(steps_per_turn=3150.0, wrong_direction=True)
    description = plain.model_copy(update={"platter": None, "board": BOARD})

    def stand(exam: Examination) -> None:
        assert exam.bench.world is not None
        exam.bench.world.put("board-on-table")

    report = report_of(description, tmp_path, ["turntable"], stand)

    assert set(named(report)) == {"turntable.direction", "turntable.steps"}
    turned = measured(report, "turntable.steps", "turned_for_360_deg")
    assert turned == pytest.approx(360.0 * 3200.0 / 3150.0, rel=5e-4)


def test_a_late_camera_that_tells_its_times_is_named(tmp_path: Path) -> None:
    report = report_of(described(**REAL_TIME, camera_latency_s=0.12), tmp_path, ["camera"])

    assert list(named(report)) == ["camera.latency"]
    # 8 ms of exposure, and 120 until it arrives.
    assert measured(report, "camera.latency", "latency_ms") == pytest.approx(128.0, abs=12.0)


def test_a_late_camera_without_times_is_named_with_what_to_write(tmp_path: Path) -> None:
    description = described(**REAL_TIME, camera_latency_s=0.12, has_timestamps=False)
    report = report_of(description, tmp_path, ["camera"])

    assert list(named(report)) == ["camera.latency"]
    found_ms = measured(report, "camera.latency", "latency_ms")
    assert found_ms == pytest.approx(128.0, abs=20.0)
    told = re.search(r"latency_ms = (\d+)", report.troubles[0].advice)
    assert told is not None
    assert float(told[1]) == pytest.approx(found_ms, abs=1.0)


def test_stale_frames_are_counted_and_are_no_latency(tmp_path: Path) -> None:
    report = report_of(described(**REAL_TIME, stale_frames=2), tmp_path, ["camera"])

    assert list(named(report)) == ["camera.stale"]
    assert "2 old pictures" in report.troubles[0].sentence
    assert measured(report, "camera.latency", "latency_ms") < 40.0


class _SlippingTable:
    """A turntable that loses a quarter of a degree in every long move up."""

    def __init__(self, exam: Examination) -> None:
        self._table: Turntable = exam.bench.turntable
        assert exam.bench.world is not None
        self._world = exam.bench.world

    def __getattr__(self, name: str) -> object:
        return getattr(self._table, name)

    def move_to(self, angle_deg: float) -> float:
        is_long = angle_deg - self._table.angle_deg > 100.0
        reached = self._table.move_to(angle_deg)
        if is_long and angle_deg > 400.0:
            self._world.plant.slip(-0.25, self._world.clock.now_s())
        return reached
