"""A scan with several exposures of every view."""

from pathlib import Path

import pytest
from bench_scans import Watching, begin, bench_with, camera_of, description, plan, world_of

from app.devices.bench import Bench
from app.devices.camera_driver import ControlName
from app.errors import DeviceRefused, OptionError
from app.recording.reader import Recording
from app.scanning.exposure_stack import check_exposures
from app.scanning.run import run_scan
from app.scanning.session import ScanSession
from app.scanning.sources import reconstruct_recording, scan_detector

_USUAL_US, _LONG_US, _SHORT_US = 4000.0, 14_000.0, 2000.0


def test_a_stack_gains_lines_and_leaves_the_camera_as_it_was(tmp_path: Path) -> None:
    with bench_with(description(rate=4.0)) as bench:
        bench.camera.set_control(ControlName.EXPOSURE, _USUAL_US)
        stacked = plan(2, lasers=("left",), exposures_us=(_SHORT_US, _LONG_US), texture_every=2)
        session = begin(tmp_path / "stack", bench, stacked)
        with pytest.raises(KeyboardInterrupt):
            run_scan(bench, session, Watching(5, _stop))
        assert _exposure_us(bench) == _USUAL_US
        session = ScanSession.resume(tmp_path / "stack")
        camera = camera_of(bench)
        watch = Watching(1, camera.freeze)
        recording = run_scan(bench, session, watch)
        assert watch.problems
        assert _exposure_us(bench) == _USUAL_US
        short = run_scan(
            bench,
            begin(tmp_path / "short", bench, plan(2, lasers=("left",), exposures_us=(_SHORT_US,))),
            Watching(),
        )
        rig = world_of(bench).rig
    assert [entry.exposure_us for entry in recording.entries] == [
        _LONG_US, _LONG_US, _SHORT_US, _SHORT_US, _USUAL_US, _LONG_US, _LONG_US, _SHORT_US, _SHORT_US
    ]  # fmt: skip
    for lit, dark in ((1, 0), (3, 2)):
        assert recording.entries[lit].lasers_on
        assert not recording.entries[dark].lasers_on
    brightness = [recording.load(recording.entries[dark]).image.mean() for dark in (0, 2)]
    assert brightness[0] > 2.0 * brightness[1]

    def points(recording: Recording) -> int:
        return sum(len(profile.cloud) for profile in reconstruct_recording(recording, rig, scan_detector()))

    assert points(recording) > 1.2 * points(short) > 0


def test_what_cannot_be_taken_is_refused_in_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with bench_with(description(rate=4.0)) as bench:
        with pytest.raises(OptionError, match=r"^A continuous scan takes every picture with one exposure"):
            check_exposures(plan(mode="continuous", exposures_us=(1000.0,)), bench.camera)
        with pytest.raises(OptionError, match=r"^An exposure is named twice"):
            check_exposures(plan(exposures_us=(1000.0, 1000.0)), bench.camera)
        with pytest.raises(DeviceRefused, match="cannot expose for 90000 us: its exposure goes from"):
            check_exposures(plan(exposures_us=(1000.0, 90_000.0)), bench.camera)
        monkeypatch.setattr(camera_of(bench), "controls", dict)
        with pytest.raises(DeviceRefused, match="has no control of its exposure"):
            check_exposures(plan(exposures_us=(1000.0,)), bench.camera)
        session = begin(tmp_path / "scan", bench, plan(2, exposures_us=(1000.0,)))
        with pytest.raises(DeviceRefused, match="has no control of its exposure"):
            run_scan(bench, session, Watching())


def _exposure_us(bench: Bench) -> float | None:
    return bench.camera.controls()[ControlName.EXPOSURE].value


def _stop() -> None:
    raise KeyboardInterrupt
