"""Cameras as Linux lists them: video nodes with their names, stable links and ranges of controls."""

import contextlib
import os
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from app.devices.camera_driver import ControlName

try:
    from fcntl import ioctl
except ImportError:  # Windows
    ioctl = None  # type: ignore[assignment]

_BUILT_IN_WORDS = ("integrated", "built-in", "builtin", "facetime", "truevision", "easycamera")
# linux/videodev2.h: _IOWR('V', 36, struct v4l2_queryctrl)
_QUERY_CONTROL = 0xC0445624
_QUERY_FORMAT = "=II32siiiiI2I"
_DISABLED = 0x1
_CONTROL_IDS = {
    ControlName.EXPOSURE: 0x009A0902,
    ControlName.GAIN: 0x00980913,
    ControlName.WHITE_BALANCE: 0x0098091A,
    ControlName.FOCUS: 0x009A090A,
    ControlName.BRIGHTNESS: 0x00980900,
}


@dataclass(frozen=True, slots=True)
class VideoNode:
    """A camera that can be opened.

    Attributes:
        path: such as /dev/video0; another one after the camera was plugged in again.
        name: what the camera calls itself.
        stable_path: a link that leads to the same camera, or the same socket, for ever; `path` where there is
            none.
        is_built_in: whether it sits in the computer's own case.
    """

    path: Path
    name: str
    stable_path: Path
    is_built_in: bool


@dataclass(frozen=True, slots=True)
class VideoNodes:
    """The nodes of a system.

    Attributes:
        devices: where device files lie.
        system: where the kernel tells of itself.
    """

    devices: Path = Path("/dev")
    system: Path = Path("/sys")

    def listed(self) -> tuple[VideoNode, ...]:
        """Every camera once, in the order of the numbers; nodes that carry only metadata are left out."""
        home = self.system / "class" / "video4linux"
        if not home.is_dir():
            return ()
        numbers = sorted(int(e.name[5:]) for e in home.glob("video*") if e.name[5:].isdigit())
        nodes = []
        for number in numbers:
            entry, path = home / f"video{number}", self.devices / f"video{number}"
            if _text(entry / "index") in ("0", "") and path.exists():
                name = _text(entry / "name") or path.name
                nodes.append(VideoNode(path, name, self._stable(path), _is_built_in(entry, name)))
        return tuple(nodes)

    def find(self, device: str | int) -> tuple[VideoNode, ...]:
        """Those that a person may mean by an index, a path or a part of the name."""
        nodes = self.listed()
        if isinstance(device, int) or device.isdigit():
            wanted = self.devices / f"video{device}"
            return tuple(n for n in nodes if n.path == wanted)
        if "/" in device:
            target = Path(os.path.realpath(device))
            return tuple(n for n in nodes if Path(os.path.realpath(n.path)) == target)
        return tuple(n for n in nodes if device.casefold() in n.name.casefold())

    def _stable(self, path: Path) -> Path:
        target = os.path.realpath(path)
        for folder in ("by-id", "by-path"):
            links = sorted((self.devices / "v4l" / folder).glob("*"))
            same = [link for link in links if os.path.realpath(link) == target]
            if same:
                return same[0]
        return path


def control_range(
    handle: int, name: ControlName, query: Callable[[int, int, bytes], bytes] | None = ioctl
) -> tuple[int, int] | None:
    """Lowest and highest raw value of a control of an open node; None where it has none or does not tell."""
    if query is None:
        return None
    question = struct.pack(_QUERY_FORMAT, _CONTROL_IDS[name], 0, b"", 0, 0, 0, 0, 0, 0, 0)
    try:
        answer = struct.unpack(_QUERY_FORMAT, query(handle, _QUERY_CONTROL, question))
    except OSError:
        return None
    lowest, highest, flags = answer[3], answer[4], answer[7]
    return None if flags & _DISABLED or lowest >= highest else (lowest, highest)


def control_ranges(path: Path | str) -> dict[ControlName, tuple[int, int]]:
    """Raw ranges of the controls that a node has; empty where it cannot be asked."""
    try:
        handle = os.open(path, os.O_RDWR | getattr(os, "O_NONBLOCK", 0))
    except OSError:
        return {}
    try:
        ranges = {name: control_range(handle, name) for name in ControlName}
    finally:
        os.close(handle)
    return {name: found for name, found in ranges.items() if found is not None}


def _is_built_in(entry: Path, name: str) -> bool:
    if any(word in name.casefold() for word in _BUILT_IN_WORDS):
        return True
    # `device` is the interface; its parent is the USB device, which knows whether its socket is in the case.
    return _text(Path(os.path.realpath(entry / "device")).parent / "removable") == "fixed"


def _text(path: Path) -> str:
    with contextlib.suppress(OSError):
        return path.read_text(errors="replace").strip()
    return ""
