"""What is measured becomes a finding: well, worth a look, or bad, with what to do."""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from app.checkup.board import judge_step
from app.checkup.camera import judge_latency, judge_rate, judge_stale, judge_stamps
from app.checkup.finding import Finding, Report, State
from app.checkup.latency import Bounds, Latency
from app.checkup.machine import judge_pace, judge_space, judge_speed, write_speed
from app.checkup.picture import judge_exposure, judge_focus, judge_noise, noise_grey
from app.checkup.sharpness import blur_px
from app.checkup.turn_words import judge_lost_steps, judge_play, judge_scale
from app.devices.camera_driver import CameraFacts
from app.devices.turntable import TurntableFacts
from app.vision.stripe import Image


def latency(latency_s: float, late_s: float | None) -> Latency:
    stamps = None if late_s is None else Bounds(late_s - 0.001, late_s + 0.001)
    return Latency(Bounds(latency_s - 0.002, latency_s), stamps, 0.01, latency_s + 0.03)


def squares(blur: float, contrast: float = 120.0) -> Image:
    """A chessboard, blurred, with a little noise."""
    tile = np.kron(np.indices((12, 16)).sum(axis=0) % 2, np.ones((30, 30))) * contrast + 60.0
    soft = cv2.GaussianBlur(tile, (0, 0), blur)
    noisy = soft + np.random.default_rng(1).normal(0.0, 0.7, soft.shape)
    return np.asarray(np.clip(noisy, 0, 255), np.uint8)


@pytest.mark.parametrize("true_px", [0.9, 1.5, 2.5, 4.0])
def test_blur_is_measured_by_the_sharpest_edges(true_px: float) -> None:
    assert blur_px(squares(true_px)) == pytest.approx(true_px, rel=0.2)


def test_a_picture_without_edges_says_nothing_of_focus() -> None:
    flat = np.full((90, 160), 100, np.uint8)

    assert math.isnan(blur_px(flat))
    assert judge_focus(blur_px(flat), 160).state is State.SKIPPED


def test_focus_is_judged_by_the_blur() -> None:
    states = [judge_focus(blur, 640).state for blur in (1.0, 3.0, 5.0)]

    assert states == [State.OK, State.ATTENTION, State.BAD]


def test_dark_and_white_pictures_are_told_apart_from_good_ones() -> None:
    dark, good, white = (np.full((90, 160, 3), grey, np.uint8) for grey in (4, 100, 255))

    assert "underexposed" in judge_exposure(dark).sentence
    assert judge_exposure(good).state is State.OK
    assert "overexposed" in judge_exposure(white).sentence


def test_noise_is_measured_from_two_pictures_of_the_same_scene() -> None:
    rng = np.random.default_rng(2)
    one, other = (np.clip(rng.normal(100.0, 8.0, (200, 300)), 0, 255).astype(np.uint8) for _ in range(2))

    assert noise_grey(one, other) == pytest.approx(8.0, rel=0.05)
    assert judge_noise(8.0).state is State.ATTENTION
    assert judge_noise(1.0).state is State.OK


def test_a_camera_slower_than_it_promises_is_named() -> None:
    facts = CameraFacts("camera", "0", (640, 480), 30.0, False, True)

    assert judge_rate(facts, 29.7).state is State.OK
    assert "15.0 pictures a second instead of the 30.0" in judge_rate(facts, 15.0).sentence


def test_a_latency_that_the_bench_file_has_wrong_matters_where_the_camera_does_not_tell_times() -> None:
    assert judge_latency(latency(0.06, None), 1 / 30, 0.0).state is State.ATTENTION
    assert judge_latency(latency(0.06, None), 1 / 30, 0.058).state is State.OK
    assert judge_latency(latency(0.06, None), 1 / 30, 0.2).state is State.ATTENTION
    assert judge_latency(latency(0.06, 0.0), 1 / 30, 0.0).state is State.OK


def test_time_stamps_that_are_wrong_are_named_with_how_much() -> None:
    assert judge_stamps(latency(0.05, 0.0)).state is State.OK
    assert "80 ms too early" in judge_stamps(latency(0.05, 0.08)).sentence
    assert "40 ms too late" in judge_stamps(latency(0.05, -0.04)).sentence


def test_one_stale_picture_is_one() -> None:
    assert judge_stale(0).state is State.OK
    assert "one old picture" in judge_stale(1).sentence


def test_disk_is_judged_by_the_scans_that_fit() -> None:
    states = [judge_space(free, 10**9).state for free in (10**9, 5 * 10**9, 10**12)]

    assert states == [State.BAD, State.ATTENTION, State.OK]
    assert "too slow" in judge_speed(1e6, 2e6).sentence
    assert judge_speed(1e7, 2e6).state is State.OK
    assert "afterwards" in judge_pace(0.1, 0.03).sentence


def test_a_folder_that_is_not_there_cannot_be_written(tmp_path: Path) -> None:
    speed, problem = write_speed(tmp_path / "nowhere", b"x" * 1000)

    assert speed == 0.0
    assert problem


def test_a_board_that_turns_by_whole_degrees_is_named() -> None:
    assert judge_step(TurntableFacts("clone", "", (1, 2), 1.0)).state is State.ATTENTION
    assert judge_step(TurntableFacts("board", "", (1, 2), 0.1125)).state is State.OK


def test_nobody_is_blamed_for_less_than_the_smallest_turn() -> None:
    for judge in (judge_play, lambda off, smallest: judge_lost_steps(off, 8, smallest)):
        assert judge(0.3, 1.0).state is State.OK
        assert judge(0.3, 0.1).state is not State.OK
        assert judge(math.nan, 0.1).state is State.SKIPPED
    assert judge_scale(1.0003, 0.1125).state is State.OK
    assert judge_scale(1.002, 0.1125).state is State.ATTENTION


def test_the_worst_trouble_comes_first() -> None:
    report = Report(
        "bench", [Finding("a", State.OK, ""), Finding("b", State.ATTENTION, ""), Finding("c", State.BAD, "")]
    )

    assert [finding.check for finding in report.troubles] == ["c", "b"]
    assert report.as_json()["is_well"] is False
