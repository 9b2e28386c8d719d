"""Lasers that do not obey, and pictures that show too little."""

from collections.abc import Callable
from pathlib import Path

import pytest
from sick_benches import described, examined, measured, named, report_of

from app.checkup.checkup import checkup, chosen
from app.checkup.examination import Examination
from app.checkup.finding import State
from app.devices.bench_file import BenchDescription
from app.devices.camera_driver import ControlName
from app.devices.turntable import Turntable
from app.errors import DeviceLost

LOOKING = ("lasers", "picture")


def test_a_laser_that_does_not_go_out_is_named(tmp_path: Path) -> None:
    # Not so fast that the firmware's laser timer runs out meanwhile.
    stuck = obey(lambda channel, is_on: channel != 1 or is_on)
    report = report_of(described(rate=8.0), tmp_path, LOOKING, stuck)

    assert list(named(report)) == ["lasers.light.left"]
    assert "stays on" in report.troubles[0].sentence


def test_a_laser_that_does_not_light_is_named(tmp_path: Path) -> None:
    report = report_of(described(), tmp_path, LOOKING, obey(lambda channel, is_on: channel != 2))

    assert list(named(report)) == ["lasers.light.right"]
    assert "does not light" in report.troubles[0].sentence


def test_a_laser_that_is_always_on_is_told_from_one_that_does_not_light(tmp_path: Path) -> None:
    def stick(exam: Examination) -> None:
        exam.bench.switch("left", True)
        obey(lambda channel, is_on: channel != 1)(exam)

    report = report_of(described(rate=8.0), tmp_path, ["lasers"], stick)

    assert list(named(report)) == ["lasers.light.left"]
    assert "on all the time" in report.troubles[0].sentence


def test_a_laser_of_another_colour_than_the_bench_file_says_is_named(tmp_path: Path) -> None:
    plain = described()
    lasers = tuple(laser.model_copy(update={"colour": "any"}) for laser in plain.lasers)
    green = (plain.lasers[0].model_copy(update={"colour": "green"}), lasers[1])
    report = report_of(
        described(saturated=True).model_copy(update={"lasers": green}), tmp_path, ["lasers"]
    )  # fmt: skip
    well = report_of(plain.model_copy(update={"lasers": lasers}), tmp_path, ["lasers"])

    assert 'colour = "red"' in named(report)["lasers.colour.left"].advice
    assert not well.troubles


def test_a_picture_out_of_focus_is_named(tmp_path: Path) -> None:
    def blur(exam: Examination) -> None:
        exam.bench.camera.set_control(ControlName.FOCUS, 120.0)

    report = report_of(described(), tmp_path, ["picture"], blur)

    assert list(named(report)) == ["picture.focus"]
    assert measured(report, "picture.focus", "blur_px") > 2.0


def test_a_dark_room_is_named(tmp_path: Path) -> None:
    def darken(exam: Examination) -> None:
        assert exam.bench.world is not None
        exam.bench.world.light = 0.1

    report = report_of(described(), tmp_path, ["picture"], darken)

    assert "picture.exposure" in named(report)
    assert "underexposed" in named(report)["picture.exposure"].sentence


def test_without_anything_to_watch_the_table_is_left_alone(tmp_path: Path) -> None:
    report = report_of(described().model_copy(update={"platter": None}), tmp_path, ["turntable"])

    assert not report.troubles
    assert [finding.state for finding in report.findings] == [State.SKIPPED]
    assert "turnscan platter" in report.findings[0].advice


def test_markers_that_are_hidden_are_asked_for(tmp_path: Path) -> None:
    def darken(exam: Examination) -> None:
        assert exam.bench.world is not None
        exam.bench.world.light = 0.0

    report = report_of(described(), tmp_path, ["turntable"], darken)

    assert [finding.state for finding in report.findings] == [State.SKIPPED]
    assert "in view" in report.findings[0].sentence


def test_a_table_without_a_board_is_not_turned(tmp_path: Path) -> None:
    document = described().model_dump() | {"turntable": {"driver": "manual"}}
    description = BenchDescription.model_validate(document, strict=False)
    report = report_of(description, tmp_path, ["lasers", "turntable"])

    assert [finding.state for finding in report.findings] == [State.SKIPPED] * 2


def test_a_table_that_does_not_turn_is_named(tmp_path: Path) -> None:
    # What the driver believes to be a turn is a thousandth of one.
    report = report_of(described(steps_per_turn=3.2e6), tmp_path, ["turntable"])

    assert "does not turn" in named(report)["turntable.turn"].sentence


def test_a_device_that_fails_is_a_finding_and_the_other_checks_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(angle_deg: float) -> float:
        raise DeviceLost("turntable", "has gone")

    with examined(described(), tmp_path) as exam:
        monkeypatch.setattr(exam.bench.turntable, "move_to", fail)
        report = checkup(exam, chosen(["turntable", "board"]))
        assert exam.bench.snapshot().lasers_on == ()

    assert named(report)["turntable"].sentence == "turntable: has gone."
    assert any(finding.check == "board.firmware" for finding in report.findings)


def obey(does: Callable[[int, bool], bool]) -> Callable[[Examination], None]:
    """Make a bench's board obey only some switchings of its lasers, by channel and wish."""

    def prepare(exam: Examination) -> None:
        exam.bench.turntable = _Stubborn(exam.bench.turntable, does)  # type: ignore[assignment]

    return prepare


class _Stubborn:
    def __init__(self, table: Turntable, does: Callable[[int, bool], bool]) -> None:
        self._table, self._does = table, does

    def __getattr__(self, name: str) -> object:
        return getattr(self._table, name)

    def set_laser(self, channel: int, is_on: bool) -> None:
        if self._does(channel, is_on):
            self._table.set_laser(channel, is_on)
