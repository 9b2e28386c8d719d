"""A table whose place is not known is found by what stands on it, or not at all."""

from pathlib import Path

import numpy as np
import pytest
from bench_scans import Watching, begin, bench_with, description, plan, true_angle_deg, world_of

from app.devices.bench import Bench
from app.scanning.find_by_picture import PictureFinder, most_alike
from app.scanning.run import run_scan

_STOPS, _STEP_DEG = 3, 45.0


@pytest.mark.parametrize(("thing", "slipped_deg"), [("mug", 12.3), ("rabbit", 0.4)])
def test_it_is_found_to_a_tenth_of_a_degree(tmp_path: Path, thing: str, slipped_deg: float) -> None:
    found, true = _found_after_a_slip(tmp_path, thing, slipped_deg)
    assert found == pytest.approx(true, abs=0.1)


def test_a_smooth_ball_tells_little_or_nothing_but_nothing_wrong(tmp_path: Path) -> None:
    found, true = _found_after_a_slip(tmp_path, "sphere", 0.4)
    assert found is None or found == pytest.approx(true, abs=0.5)


def test_an_empty_table_that_looks_the_same_all_round_tells_nothing(tmp_path: Path) -> None:
    with bench_with(description()) as bench:
        world_of(bench).put("nothing")
        _scan_some(tmp_path, bench)
        assert PictureFinder(tmp_path / "scan")(bench, 90.0, 100.0) is None


def test_a_scan_without_dark_pictures_tells_nothing(tmp_path: Path) -> None:
    with bench_with(description()) as bench:
        run_scan(bench, begin(tmp_path / "scan", bench, plan(2, with_dark=False)), Watching())
        assert PictureFinder(tmp_path / "scan")(bench, 0.0, 10.0) is None


def test_the_bottom_of_the_differences_is_found_between_the_angles_that_were_tried() -> None:
    noise = np.random.default_rng(0)

    def unlike(angle: float, blur_px: float) -> float:
        return float(
            5.0 * (1.0 - np.exp(-(((angle - 7.13) / (0.4 * blur_px + 1.0)) ** 2))) + 0.01 * noise.random()
        )

    assert most_alike(unlike, 0.0, 20.0) == pytest.approx(7.13, abs=0.03)


def test_differences_without_a_bottom_have_none() -> None:
    noise = np.random.default_rng(1)
    assert most_alike(lambda angle, blur_px: 1.0 + 0.01 * noise.random(), 0.0, 20.0) is None


def _found_after_a_slip(folder: Path, thing: str, slipped_deg: float) -> tuple[float | None, float]:
    """Where pictures say that the table stands, and where it does."""
    low_deg = _STEP_DEG * (_STOPS - 1)
    with bench_with(description(object=thing, width=640, height=480)) as bench:
        _scan_some(folder, bench)
        world = world_of(bench)
        bench.turntable.move_to(low_deg)
        world.plant.slip(slipped_deg, world.clock.now_s())
        found = PictureFinder(folder / "scan")(bench, low_deg, low_deg + _STEP_DEG)
        return found, true_angle_deg(bench)


def _scan_some(folder: Path, bench: Bench) -> None:
    """The first stops of a scan, then somebody stops it."""

    def stop() -> None:
        raise KeyboardInterrupt

    session = begin(folder / "scan", bench, plan(8))
    with pytest.raises(KeyboardInterrupt):
        run_scan(bench, session, Watching(3 * _STOPS, stop))
