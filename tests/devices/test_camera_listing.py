"""Which cameras there are, told from a pretend /sys and /dev."""

import os
import struct
from pathlib import Path

import pytest

from app.devices.camera_listing import FoundCamera, capability_flags, found_cameras
from app.devices.video_nodes import VideoNodes

_CAPTURE, _METADATA, _CONVERTER = 0x1, 0x00800000, 0x8000


class Computer:
    """A pretend Linux machine."""

    def __init__(self, root: Path) -> None:
        self.nodes = VideoNodes(root / "dev", root / "sys")
        self.flags: dict[str, int] = {}
        for folder in ("dev/v4l/by-id", "dev/v4l/by-path", "sys/class/video4linux"):
            (root / folder).mkdir(parents=True)

    def plug(
        self,
        number: int,
        name: str,
        *,
        usb: str = "",
        serial: str = "",
        removable: str = "removable",
        index: int = 0,
        flags: int = _CAPTURE,
        by_id: str = "",
        by_path: str = "",
    ) -> None:
        """Put a node there."""
        devices, system = self.nodes.devices, self.nodes.system
        node = devices / f"video{number}"
        node.touch()
        self.flags[node.name] = flags
        device = system / f"usb{number}"
        (device / "interface").mkdir(parents=True)
        (device / "removable").write_text(removable + "\n")
        if usb:
            vendor, product = usb.split(":")
            (device / "idVendor").write_text(vendor + "\n")
            (device / "idProduct").write_text(product + "\n")
        if serial:
            (device / "serial").write_text(serial + "\n")
        entry = system / "class/video4linux" / node.name
        entry.mkdir()
        (entry / "name").write_text(name + "\n")
        (entry / "index").write_text(f"{index}\n")
        (entry / "device").symlink_to(device / "interface")
        for folder, link in (("by-id", by_id), ("by-path", by_path)):
            if link:
                (devices / "v4l" / folder / link).symlink_to(node)

    def cameras(self) -> list[FoundCamera]:
        return found_cameras(self.nodes, lambda path: self.flags[path.name], platform="linux")


@pytest.fixture
def computer(tmp_path: Path) -> Computer:
    return Computer(tmp_path)


def test_a_webcam_has_a_name_that_lasts_and_its_serial_number(computer: Computer) -> None:
    computer.plug(
        2, "C920", usb="046d:082d", serial="9F3A", by_id="usb-046d_C920_9F3A-index0", by_path="pci-1-index0"
    )
    (camera,) = computer.cameras()
    assert Path(str(camera.device)).name == "usb-046d_C920_9F3A-index0"
    assert Path(camera.path).name == "video2"
    assert (camera.name, camera.usb_id, camera.serial_number) == ("C920", (0x046D, 0x082D), "9F3A")
    assert not camera.is_built_in
    assert not camera.problem


def test_the_laptops_own_camera_is_known_by_its_socket_or_its_name_and_comes_last(computer: Computer) -> None:
    computer.plug(0, "HD Camera", usb="04f2:b6d0", removable="fixed")
    computer.plug(2, "Integrated Camera: Integrated C", usb="04f2:b6d1", removable="unknown")
    computer.plug(4, "C270", usb="046d:0825")
    assert [(camera.name[:10], camera.is_built_in) for camera in computer.cameras()] == [
        ("C270", False),
        ("HD Camera", True),
        ("Integrated", True),
    ]


def test_nodes_that_give_no_pictures_are_left_out(computer: Computer) -> None:
    computer.plug(0, "C920", index=0)
    computer.plug(1, "C920", index=1, flags=_METADATA)
    computer.plug(10, "bcm2835-codec", flags=_CONVERTER)
    computer.plug(11, "telemetry", flags=_METADATA)
    assert [camera.name for camera in computer.cameras()] == ["C920"]


def test_twins_without_serial_numbers_are_told_apart_by_their_sockets(computer: Computer) -> None:
    computer.plug(0, "USB Camera", usb="0c45:6366", by_id="usb-Camera-index0", by_path="pci-usb-0:1-index0")
    computer.plug(2, "USB Camera", usb="0c45:6366", by_path="pci-usb-0:2-index0")
    assert [Path(str(camera.device)).name for camera in computer.cameras()] == [
        "pci-usb-0:1-index0",
        "pci-usb-0:2-index0",
    ]


def test_a_camera_that_may_not_be_opened_says_what_to_do(
    computer: Computer, monkeypatch: pytest.MonkeyPatch
) -> None:
    computer.plug(0, "C920")
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    (camera,) = computer.cameras()
    assert camera.problem.startswith("This user may not open it.")


def test_without_cameras_the_list_is_empty(computer: Computer) -> None:
    assert computer.cameras() == []


def test_other_systems_have_indices() -> None:
    cameras = found_cameras(can_open=lambda number: number in (0, 2), platform="win32")
    assert [camera.device for camera in cameras] == [0, 2]


@pytest.mark.parametrize(
    ("whole", "own", "flags"), [(0x80000000 | 0x00800001, 0x00800000, 0x00800000), (0x1, 0, 0x1)]
)
def test_a_node_is_judged_by_its_own_capabilities_where_it_tells_them(
    whole: int, own: int, flags: int
) -> None:
    answer = struct.pack("=16s32s32sIII3I", b"uvcvideo", b"C920", b"usb", 0, whole, own, 0, 0, 0)
    assert len(answer) == 104
    assert capability_flags(answer) == flags
