"""Serial ports under names that last."""

import os
from dataclasses import dataclass
from pathlib import Path

import pytest

from app.devices.ports import SerialPort, join_group, resolve_port, serial_ports
from app.errors import DeviceNotFound


@dataclass
class Listed:
    """A port as pyserial lists it."""

    device: str
    description: str = "n/a"
    hwid: str = "n/a"
    vid: int | None = None
    pid: int | None = None
    serial_number: str | None = None


@pytest.fixture
def root(tmp_path: Path) -> Path:
    for folder in ("dev/serial/by-id", "dev/serial/by-path", "sys/class/tty"):
        (tmp_path / folder).mkdir(parents=True)
    return tmp_path


def node(root: Path, name: str, by_id: str = "", by_path: str = "") -> None:
    """A pretend device with its links."""
    (root / "dev" / name).touch()
    for folder, link in (("by-id", by_id), ("by-path", by_path)):
        if link:
            (root / "dev/serial" / folder / link).symlink_to(f"../../{name}")


def test_an_adapter_with_a_serial_number_is_named_by_it(root: Path) -> None:
    node(root, "ttyUSB0", "usb-FTDI_A50285BI-if00-port0", "pci-0000:00:14.0-usb-0:2:1.0-port0")
    listed = [Listed("/dev/ttyUSB0", "FT232R", "USB", 0x0403, 0x6001, "A50285BI")]
    (port,) = serial_ports(root, lambda: listed)
    assert port.stable_name == str(root / "dev/serial/by-id/usb-FTDI_A50285BI-if00-port0")
    assert (port.path, port.description, port.usb_id) == ("/dev/ttyUSB0", "FT232R", (0x0403, 0x6001))


def test_two_adapters_without_serial_numbers_are_named_by_their_sockets(root: Path) -> None:
    node(root, "ttyUSB0", "usb-1a86_USB2.0-Serial-if00-port0", "socket-1")
    node(root, "ttyUSB1", "", "socket-2")
    listed = [Listed(f"/dev/ttyUSB{n}", "USB2.0-Serial", "USB", 0x1A86, 0x7523) for n in (0, 1)]
    assert [Path(port.stable_name).name for port in serial_ports(root, lambda: listed)] == [
        "socket-1",
        "socket-2",
    ]
    (alone,) = serial_ports(root, lambda: listed[:1])
    assert Path(alone.stable_name).name == "usb-1a86_USB2.0-Serial-if00-port0"


def test_where_there_are_no_links_the_usb_number_names_the_port(root: Path) -> None:
    listed = [Listed("COM7", "Arduino Uno", "USB", 0x2341, 0x0043, "75633313")]
    (port,) = serial_ports(root, lambda: listed)
    assert port.stable_name == "usb:2341:0043:75633313"


def test_a_remembered_name_is_found_under_another_node() -> None:
    ports = [
        SerialPort("COM3", "", usb_id=(0x2341, 0x0043), serial_number="1"),
        SerialPort("COM9", "", usb_id=(0x2341, 0x0043), serial_number="75633313"),
    ]
    assert resolve_port("usb:2341:0043:75633313", lambda: ports) == "COM9"
    assert resolve_port("usb:2341:0043", lambda: ports) == "COM3"
    for other in ("/dev/ttyUSB0", "socket://bridge:23", "COM4"):
        assert resolve_port(other, lambda: ports) == other
    with pytest.raises(DeviceNotFound, match="not plugged in"):
        resolve_port("usb:1a86:7523", lambda: ports)


def test_ports_without_hardware_are_left_out(root: Path) -> None:
    (root / "sys/class/tty/console").mkdir()
    (root / "sys/class/tty/console/active").write_text("tty0 ttyS3\n")
    for name, kind in (("ttyS0", "4"), ("ttyS1", "0"), ("ttyS3", "4")):
        node(root, name)
        folder = root / "sys/class/tty" / name
        folder.mkdir()
        (folder / "type").write_text(kind + "\n")
    listed = [
        Listed("/dev/ttyS0"),
        Listed("/dev/ttyS1"),
        Listed("/dev/ttyS2"),
        Listed("/dev/ttyS3"),
        Listed("/dev/cu.Bluetooth-Incoming-Port"),
        Listed("/dev/ttyAMA0"),
        Listed("/dev/rfcomm0"),
    ]
    assert [port.path for port in serial_ports(root, lambda: listed)] == [
        "/dev/rfcomm0",
        "/dev/ttyAMA0",
        "/dev/ttyS0",
    ]


def test_a_port_that_may_not_be_opened_says_which_group_to_join(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    node(root, "ttyUSB0")
    # Whoever runs the tests may be allowed everything.
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    (port,) = serial_ports(root, lambda: [Listed("/dev/ttyUSB0", vid=1, pid=2)])
    assert port.problem.startswith("This user may not open it.")


def test_the_group_is_the_one_that_owns_the_device(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    grp = pytest.importorskip("grp")
    monkeypatch.setattr(grp, "getgrgid", lambda number: grp.struct_group(("uucp", "x", number, [])))
    (tmp_path / "ttyUSB0").touch()
    assert "usermod -a -G uucp $USER" in join_group(tmp_path / "ttyUSB0")
    assert "-G dialout" in join_group(tmp_path / "gone")
