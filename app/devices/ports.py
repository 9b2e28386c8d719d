"""Serial ports that may have a board, under names that stay the same when they are plugged in again."""

import os
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from serial.tools import list_ports

from app.errors import DeviceNotFound

ROOT = Path("/")
_USB_NAME = re.compile(r"usb:([0-9a-f]{4}):([0-9a-f]{4})(?::(.+))?", re.IGNORECASE)
# Ports that systems list though no board can be behind them.
_NO_BOARD = ("Bluetooth-Incoming-Port", "debug-console", "wlan-debug", "MALS", "SOC")
_LINKS = ("dev/serial/by-id", "dev/serial/by-path")


@dataclass(frozen=True, slots=True)
class SerialPort:
    """A port of this computer.

    Attributes:
        path: what it is called now, such as /dev/ttyUSB0 or COM3.
        stable_name: what it is called after plugging it in again, too; a path, or `usb:VID:PID:SERIAL`.
        description: what the adapter calls itself.
        usb_id: vendor and product of a USB adapter.
        serial_number: of the adapter; empty for none.
        problem: why this user cannot open it, with what to do; empty for nothing known.
    """

    path: str
    stable_name: str
    description: str = ""
    usb_id: tuple[int, int] | None = None
    serial_number: str = ""
    problem: str = ""


class PortFacts(Protocol):
    """What pyserial tells of a port."""

    device: str
    description: str
    hwid: str
    vid: int | None
    pid: int | None
    serial_number: str | None


def serial_ports(
    root: Path = ROOT, listed: Callable[[], Iterable[PortFacts]] = list_ports.comports
) -> list[SerialPort]:
    """The ports that may have a board, by name.

    Args:
        root: where /dev and /sys are.
        listed: who lists them.
    """
    facts = [port for port in listed() if _may_have_board(port, root)]
    links = [_links(root / folder) for folder in _LINKS]
    found = []
    for port in facts:
        usb_id = None if port.vid is None or port.pid is None else (port.vid, port.pid)
        is_alone = sum((other.vid, other.pid) == (port.vid, port.pid) for other in facts) == 1
        found.append(
            SerialPort(
                port.device,
                _stable_name(port, links, is_alone=is_alone),
                "" if port.description in ("n/a", port.device) else port.description,
                usb_id,
                port.serial_number or "",
                _problem(_below(root, port.device)),
            )
        )
    return sorted(found, key=lambda port: port.path)


def resolve_port(name: str, ports: Callable[[], Sequence[SerialPort]] = serial_ports) -> str:
    """What a port is called now: paths and URLs as they are, `usb:VID:PID:SERIAL` looked up.

    Raises:
        DeviceNotFound: no such adapter is plugged in.
    """
    match = _USB_NAME.fullmatch(name)
    if match is None:
        return name
    wanted = (int(match[1], 16), int(match[2], 16))
    for port in ports():
        if port.usb_id == wanted and (match[3] is None or port.serial_number == match[3]):
            return port.path
    raise DeviceNotFound(name, "this USB adapter is not plugged in")


def lasting_name(path: str, ports: Callable[[], Sequence[SerialPort]] = serial_ports) -> str:
    """What a port that is plugged in now will be called after plugging it in again; empty where unknown."""
    real = str(Path(path).resolve())
    return next((port.stable_name for port in ports() if port.path in (path, real)), "")


def join_group(path: str | Path) -> str:
    """The command that lets a user open a device, where the system has groups."""
    group = "dialout"
    try:
        import grp

        group = grp.getgrgid(Path(path).stat().st_gid).gr_name
    except (ImportError, KeyError, OSError):
        pass
    if group == "root":
        return "It belongs to root alone: run the command with sudo once, or add a udev rule for the device."
    return f"Join the group that owns it: `sudo usermod -a -G {group} $USER`, then log in again."


def _may_have_board(port: PortFacts, root: Path) -> bool:
    if any(name in port.device for name in _NO_BOARD) or Path(port.device).name in _consoles(root):
        return False
    if port.vid is not None or not Path(port.device).name.startswith("ttyS"):
        return True
    # The kernel lists a fixed number of such ports; type 0 is one without hardware.
    try:
        return (root / "sys/class/tty" / Path(port.device).name / "type").read_text().strip() != "0"
    except OSError:
        return False


def _consoles(root: Path) -> list[str]:
    """Ports on which the system itself speaks."""
    try:
        return (root / "sys/class/tty/console/active").read_text().split()
    except OSError:
        return []


def _links(folder: Path) -> dict[str, str]:
    """Links of a folder of /dev: name of the node, and the link to it."""
    try:
        return {link.resolve().name: str(link) for link in sorted(folder.iterdir()) if link.is_symlink()}
    except OSError:
        return {}


def _stable_name(port: PortFacts, links: list[dict[str, str]], *, is_alone: bool) -> str:
    """By serial number where there is one; adapters without, when there are several, by their socket."""
    by_id, by_path = (link.get(Path(port.device).name, "") for link in links)
    is_unmistakable = bool(port.serial_number) or is_alone
    chosen = (by_id or by_path) if is_unmistakable else (by_path or by_id)
    if chosen:
        return chosen
    if port.vid is None or port.pid is None or not is_unmistakable:
        return port.device
    serial_number = f":{port.serial_number}" if port.serial_number else ""
    return f"usb:{port.vid:04x}:{port.pid:04x}{serial_number}"


def _below(root: Path, device: str) -> Path:
    return root / device.lstrip("/") if device.startswith("/") else Path(device)


def _problem(path: Path) -> str:
    if not path.exists() or os.access(path, os.R_OK | os.W_OK):
        return ""
    return f"This user may not open it. {join_group(path)}"
