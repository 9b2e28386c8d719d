"""`turnscan devices` as a person runs it."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from command_line import turnscan

from app.cli import devices
from app.devices.bench_file import read_bench_file
from app.devices.camera_listing import FoundCamera
from app.devices.ports import SerialPort
from app.simulation.clock import Clock
from app.simulation.firmware.dialects.sardauscan import Sardauscan
from app.simulation.firmware.plant import Plant, Wiring
from app.simulation.firmware.port import EmulatedPort

_WEBCAM = FoundCamera("/dev/v4l/by-id/usb-C920", "/dev/video2", "C920", (0x046D, 0x082D), "9F3A")
_OWN = FoundCamera("/dev/video0", "/dev/video0", "Integrated Camera", is_built_in=True)


@pytest.fixture
def bare(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """A computer with nothing plugged in, whatever this one has."""
    monkeypatch.setattr(devices, "serial_ports", list)
    monkeypatch.setattr(devices, "found_cameras", list)
    return monkeypatch


@pytest.fixture
def sardauscan(tmp_path: Path) -> Iterator[str]:
    """Path of a port with a board behind it."""
    firmware = Sardauscan(Plant(Wiring(Sardauscan.steps_per_turn)))
    with EmulatedPort(firmware, tmp_path / "ttyUSB0", Clock(4.0)) as emulator:
        yield str(emulator.link)


def test_without_anything_it_says_what_to_do(bare: pytest.MonkeyPatch) -> None:
    ended = turnscan("devices")
    assert ended.code == 0
    assert "no serial port has an adapter" in ended.said
    assert "carries data" in ended.said
    assert "A phone is a camera" in ended.said


def test_without_anything_no_bench_is_written(bare: pytest.MonkeyPatch, tmp_path: Path) -> None:
    ended = turnscan("devices", "--write", tmp_path / "bench.toml")
    assert ended.code == 2
    assert "no board was recognised and no camera found" in ended.sentence
    assert "--bench simulated" in ended.sentence
    assert not (tmp_path / "bench.toml").exists()


def test_a_port_that_is_typed_in_is_asked(bare: pytest.MonkeyPatch, sardauscan: str) -> None:
    ended = turnscan("devices", "--port", sardauscan)
    assert ended.code == 0
    assert f'{sardauscan} Sardauscan 0.1a at 115200 baud, driver "sardauscan"' in ended.said


def test_a_node_that_is_typed_in_is_written_under_its_lasting_name(
    bare: pytest.MonkeyPatch, sardauscan: str, tmp_path: Path
) -> None:
    listed = SerialPort(sardauscan, "/dev/serial/by-id/usb-FTDI_A5", "FT232R", (0x0403, 0x6001), "A5")
    bare.setattr(devices, "serial_ports", lambda: [listed])
    node = str(Path(sardauscan).resolve())
    assert turnscan("devices", "--port", node, "--write", tmp_path / "bench.toml").code == 0
    assert read_bench_file(tmp_path / "bench.toml").turntable.options == {"port": listed.stable_name}


def test_boards_and_cameras_are_listed_with_all_their_names(
    bare: pytest.MonkeyPatch, sardauscan: str, tmp_path: Path
) -> None:
    gone = SerialPort(str(tmp_path / "ttyUSB9"), "usb:1a86:7523", "CH340", (0x1A86, 0x7523))
    here = SerialPort(sardauscan, "/dev/serial/by-id/usb-FTDI_A5", "FT232R", (0x0403, 0x6001), "A5")
    bare.setattr(devices, "serial_ports", lambda: [here, gone])
    bare.setattr(devices, "found_cameras", lambda: [_WEBCAM, _OWN])
    said = turnscan("devices").said
    assert f"/dev/serial/by-id/usb-FTDI_A5 {sardauscan}, FT232R, USB 0403:6001, serial number A5" in said
    assert "there is no port" in said
    assert "/dev/v4l/by-id/usb-C920 /dev/video2, C920, USB 046d:082d, serial number 9F3A" in said
    assert said.count("Probably the computer's own") == 1


def test_names_can_be_listed_without_waking_a_board(bare: pytest.MonkeyPatch, sardauscan: str) -> None:
    denied = SerialPort(sardauscan, sardauscan, problem="This user may not open it. Join the group.")
    bare.setattr(devices, "serial_ports", lambda: [denied])
    bare.setattr(devices, "identify", lambda *_: pytest.fail("the port was opened"))
    assert "Join the group" in turnscan("devices", "--names-only").said


def test_a_bench_file_is_drafted_that_can_be_read(
    bare: pytest.MonkeyPatch, sardauscan: str, tmp_path: Path
) -> None:
    bare.setattr(devices, "found_cameras", lambda: [_WEBCAM, _OWN])
    file = tmp_path / "bench.toml"
    ended = turnscan("devices", "--port", sardauscan, "--write", file)
    assert ended.code == 0
    assert "turnscan doctor" in ended.said
    bench = read_bench_file(file)
    assert (bench.turntable.driver, bench.turntable.options) == ("sardauscan", {"port": sardauscan})
    assert bench.camera.options == {"device": "/dev/v4l/by-id/usb-C920"}
    assert [(laser.name, laser.channel) for laser in bench.lasers] == [("left", 0), ("right", 1)]
    again = turnscan("devices", "--port", sardauscan, "--write", file)
    assert again.code == 2
    assert "is there already" in again.sentence


def test_with_a_camera_alone_a_person_turns_the_table(bare: pytest.MonkeyPatch, tmp_path: Path) -> None:
    bare.setattr(devices, "found_cameras", lambda: [_OWN])
    ended = turnscan("devices", "--write", tmp_path / "bench.toml")
    assert ended.code == 0
    assert 'driver "manual"' in ended.said
    assert "computer's own" in ended.said
    assert read_bench_file(tmp_path / "bench.toml").turntable.driver == "manual"


def test_a_missing_port_is_a_sentence_and_not_the_end(bare: pytest.MonkeyPatch, tmp_path: Path) -> None:
    ended = turnscan("devices", "--port", tmp_path / "ttyUSB7")
    assert ended.code == 0
    assert "there is no port" in ended.said
    assert "Plug it in" in ended.said
