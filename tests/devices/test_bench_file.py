"""Bench files: what people write, and what they get wrong."""

from pathlib import Path

import pytest

from app.devices.bench_file import (
    LaserChoice,
    draft_bench,
    parse_bench,
    read_bench_file,
    simulated_description,
    write_bench_file,
)
from app.devices.camera_driver import ControlName
from app.errors import BenchFileError
from app.simulation.firmware.kernel import FIRMWARES

_SMALLEST = '[turntable]\ndriver = "horus"\n[camera]\ndriver = "uvc"\n'


def test_the_smallest_file_has_sensible_values() -> None:
    bench = parse_bench(_SMALLEST.encode(), "bench.toml")
    assert bench.turntable.direction == "ccw"
    assert bench.camera.rotation == 0
    assert bench.lasers == ()
    assert not bench.is_simulated


def test_further_keys_are_options_of_the_driver() -> None:
    text = _SMALLEST.replace('"horus"\n', '"horus"\nport = "/dev/ttyUSB0"\nspeed_deg_s = 30.0\n')
    bench = parse_bench(text.encode(), "bench.toml")
    assert bench.turntable.options == {"port": "/dev/ttyUSB0", "speed_deg_s": 30.0}


def test_controls_are_set_for_each_use() -> None:
    text = _SMALLEST + '[camera.laser]\nexposure = 4000\ngain = "auto"\n[camera.texture]\nexposure = 12000\n'
    bench = parse_bench(text.encode(), "bench.toml")
    assert bench.camera.laser.values == {ControlName.EXPOSURE: 4000.0, ControlName.GAIN: None}
    assert bench.camera.board.values == {}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "turntable: is missing"),
        ("name = ", "is not TOML"),
        (_SMALLEST + "when = 2020-01-01\n", "such as a date"),
        (_SMALLEST + "rotation = 45\n", "camera.rotation: must be 0, 90, 180 or 270"),
        (_SMALLEST + "latency_ms = -3\n", "camera.latency_ms"),
        (_SMALLEST + "[camera.laser]\nexposr = 4\n", "no control 'exposr'"),
        (_SMALLEST + "[camera.laser]\nexposure = true\n", 'must be a number or "auto"'),
        (_SMALLEST.replace('"horus"', '"horus"\ndirection = "left"'), "turntable.direction"),
        (_SMALLEST + '[[lasers]]\nname = "a"\ncolour = "red"\n', "channel: is missing"),
        (
            _SMALLEST + 2 * '[[lasers]]\nname = "a"\nchannel = 1\ncolour = "red"\n',
            "two lasers with the name 'a'",
        ),
        (_SMALLEST + "[cammera]\n", "means nothing: 'cammera'"),
    ],
)
def test_what_is_wrong_is_named(text: str, said: str) -> None:
    with pytest.raises(BenchFileError, match=r"bench\.toml") as told:
        parse_bench(text.encode(), "bench.toml")
    assert said in told.value.message


def test_bytes_that_are_no_text_are_named() -> None:
    with pytest.raises(BenchFileError, match="not UTF-8"):
        parse_bench(b"name = '\xff'", "bench.toml")


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(BenchFileError, match="no such file"):
        read_bench_file(tmp_path / "bench.toml")


def test_a_draft_can_be_read_back(tmp_path: Path) -> None:
    text = draft_bench(
        {"driver": "grbl", "port": 'odd "name"'},
        {"driver": "uvc", "device": 2},
        [LaserChoice("only", 1, "green")],
    )
    write_bench_file(tmp_path / "bench.toml", text)
    bench = read_bench_file(tmp_path / "bench.toml")
    assert bench.turntable.options == {"port": 'odd "name"'}
    assert [laser.colour for laser in bench.lasers] == ["green"]


@pytest.mark.parametrize("dialect", sorted(FIRMWARES))
def test_a_simulated_bench_numbers_its_lasers_as_its_board_does(dialect: str) -> None:
    bench = simulated_description(dialect)
    channels: tuple[int, ...] = FIRMWARES.maker(dialect).channels  # type: ignore[attr-defined]
    assert [laser.channel for laser in bench.lasers] == list(channels[:2])
