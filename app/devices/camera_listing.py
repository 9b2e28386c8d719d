"""Cameras of this computer, with names that last, and what keeps one from being used."""

import os
import struct
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2

from app.devices.ports import join_group
from app.devices.video_nodes import VideoNode, VideoNodes

# linux/videodev2.h: _IOR('V', 0, struct v4l2_capability)
_QUERY_CAPABILITY = 0x80685600
_CAPABILITY_FORMAT = "=16s32s32sIII3I"
_HAS_DEVICE_CAPABILITIES = 0x80000000
_CAPTURE, _CONVERT = 0x1 | 0x1000, 0x4000 | 0x8000
_MOST_INDICES = 6


@dataclass(frozen=True, slots=True)
class FoundCamera:
    """A camera that is plugged in.

    Attributes:
        device: what the driver `uvc` is given: a name that lasts where the system has one, else an index.
        path: what it is called now.
        name: what it calls itself.
        usb_id: vendor and product.
        serial_number: empty for none.
        is_built_in: whether it is probably the computer's own.
        problem: why this user cannot open it, with what to do; empty for nothing known.
    """

    device: str | int
    path: str
    name: str
    usb_id: tuple[int, int] | None = None
    serial_number: str = ""
    is_built_in: bool = False
    problem: str = ""


def found_cameras(
    nodes: VideoNodes | None = None,
    capabilities: Callable[[Path], int | None] | None = None,
    can_open: Callable[[int], bool] | None = None,
    platform: str = sys.platform,
) -> list[FoundCamera]:
    """Every camera that programs can take pictures with; the computer's own come last.

    Args:
        nodes: where Linux lists them.
        capabilities: of a node, as V4L2 tells them; None where it cannot be asked.
        can_open: whether OpenCV opens an index, for systems without such lists.
        platform: as `sys.platform`.
    """
    if platform != "linux":
        is_there = can_open or _opens
        found = [n for n in range(_MOST_INDICES) if is_there(n)]
        return [FoundCamera(number, str(number), f"camera {number}") for number in found]
    nodes = nodes or VideoNodes()
    listed = [node for node in nodes.listed() if _captures((capabilities or _capabilities)(node.path))]
    identities = {node: _usb_identity(nodes, node) for node in listed}
    cameras = []
    for node, (usb_id, serial_number) in identities.items():
        is_alone = list(identities.values()).count((usb_id, serial_number)) == 1
        cameras.append(
            FoundCamera(
                str(node.stable_path if is_alone else _socket_path(nodes, node)),
                str(node.path),
                node.name,
                usb_id,
                serial_number,
                node.is_built_in,
                _problem(node.path),
            )
        )
    return sorted(cameras, key=lambda camera: camera.is_built_in)


def _captures(flags: int | None) -> bool:
    """Whether pictures come out of a node: not of one for metadata, nor of a converter of a Raspberry Pi."""
    return flags is None or (bool(flags & _CAPTURE) and not flags & _CONVERT)


def _capabilities(path: Path) -> int | None:
    from fcntl import ioctl  # Windows has none.

    try:
        handle = os.open(path, os.O_RDWR | os.O_NONBLOCK)
    except OSError:
        return None
    try:
        answer = ioctl(handle, _QUERY_CAPABILITY, bytes(struct.calcsize(_CAPABILITY_FORMAT)))
    except OSError:
        return None
    finally:
        os.close(handle)
    return capability_flags(answer)


def capability_flags(answer: bytes) -> int:
    """What a node can do, out of a `struct v4l2_capability`: itself where it tells, else its whole device."""
    whole, own = struct.unpack(_CAPABILITY_FORMAT, answer)[4:6]
    return int(own if whole & _HAS_DEVICE_CAPABILITIES else whole)


def _usb_identity(nodes: VideoNodes, node: VideoNode) -> tuple[tuple[int, int] | None, str]:
    """Vendor and product, and the serial number, of the USB device above a node's interface."""
    interface = nodes.system / "class" / "video4linux" / node.path.name / "device"
    device = Path(os.path.realpath(interface)).parent
    try:
        usb_id = (
            int((device / "idVendor").read_text(), 16),
            int((device / "idProduct").read_text(), 16),
        )
    except (OSError, ValueError):
        return None, ""
    try:
        return usb_id, (device / "serial").read_text(errors="replace").strip()
    except OSError:
        return usb_id, ""


def _socket_path(nodes: VideoNodes, node: VideoNode) -> Path:
    """The link by the USB socket, for cameras that cannot be told apart."""
    target = os.path.realpath(node.path)
    links: Sequence[Path] = sorted((nodes.devices / "v4l" / "by-path").glob("*"))
    return next((link for link in links if os.path.realpath(link) == target), node.path)


def _problem(path: Path) -> str:
    if os.access(path, os.R_OK | os.W_OK):
        return ""
    return f"This user may not open it. {join_group(path)}"


def _opens(number: int) -> bool:
    capture = cv2.VideoCapture(number)
    try:
        return capture.isOpened()
    finally:
        capture.release()
