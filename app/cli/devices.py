"""`turnscan devices`: what is plugged in, what it is, and a first bench file for it."""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from app.cli.console import check_output, console, say, warn
from app.devices.bench_file import LaserChoice, draft_bench, write_bench_file
from app.devices.camera_listing import FoundCamera, found_cameras
from app.devices.identify import Identity, identify
from app.devices.ports import SerialPort, serial_ports
from app.devices.presets import LASERS
from app.errors import BenchFileError, DeviceError, OutputError

_AT_ONCE = 8


@dataclass(frozen=True, slots=True)
class _Board:
    """A port, and what is behind it: an identity, or the reason why there is none."""

    port: SerialPort
    identity: Identity | None
    error: DeviceError | None = None

    @property
    def is_usable(self) -> bool:
        return self.identity is not None and bool(self.identity.driver)


def devices_command(
    port: Annotated[
        list[str] | None,
        typer.Option(
            help="Ask this port alone: a path, COM3, or a bridge such as socket://host:23. May be repeated."
        ),
    ] = None,
    write: Annotated[
        Path | None, typer.Option(help="Write a first bench file for what was found, such as bench.toml.")
    ] = None,
    names_only: Annotated[
        bool, typer.Option("--names-only", help="Open no port: a board that is opened usually starts anew.")
    ] = False,
) -> None:
    """List boards and cameras under names that last, and say which firmware each board has.

    No laser is switched and no table moved.
    """
    if write is not None:
        _check_new(write)
    ports = serial_ports()
    if port:
        ports = [_named(name, ports) for name in port]
    boards = [_Board(each, None) for each in ports] if names_only else _identified(ports)
    cameras = found_cameras()
    say(_board_lines(boards))
    say(_camera_lines(cameras))
    if write is not None:
        _write(write, [board for board in boards if board.is_usable], cameras)


def _named(name: str, listed: Sequence[SerialPort]) -> SerialPort:
    """A port that was typed in, with what is known of it where it is listed under another name."""
    target = os.path.realpath(name)
    return next((port for port in listed if target == os.path.realpath(port.path)), SerialPort(name, name))


def _identified(ports: Sequence[SerialPort]) -> list[_Board]:
    if ports:
        what = "this port" if len(ports) == 1 else f"{len(ports)} ports"
        console.print(f"Listening to {what}; this takes some seconds.", markup=False)
    with ThreadPoolExecutor(_AT_ONCE) as pool:
        return list(pool.map(_identify, ports))


def _identify(port: SerialPort) -> _Board:
    try:
        return _Board(port, identify(port.path, port.usb_id))
    except DeviceError as error:
        return _Board(port, None, error)


def _board_lines(boards: Sequence[_Board]) -> list[str]:
    if not boards:
        return [
            "Boards: no serial port has an adapter behind it.",
            "  Plug the board in with a cable that carries data, not only power.",
            "  Network bridges and pseudo-terminals are not listed; name one with --port.",
        ]
    lines = ["Boards:"]
    for board in boards:
        port = board.port
        lines.append(f"  {port.stable_name}")
        told = [port.path if port.path != port.stable_name else "", port.description, _usb(port.usb_id)]
        if port.serial_number:
            told.append(f"serial number {port.serial_number}")
        lines += _detail(", ".join(word for word in told if word))
        lines += _findings(board)
    return lines


def _findings(board: _Board) -> list[str]:
    if board.error is not None:
        return [*_detail(f"{board.error.message}."), *_detail(board.error.hint)]
    if board.identity is None:
        return _detail(board.port.problem)
    identity = board.identity
    rate = f" at {identity.baud} baud" if identity.baud else ""
    driver = f', driver "{identity.driver}"' if identity.driver else ""
    lines = _detail(f"{identity.firmware}{rate}{driver}")
    for note in identity.notes:
        lines += _detail(note)
    return lines


def _camera_lines(cameras: Sequence[FoundCamera]) -> list[str]:
    if not cameras:
        return [
            "Cameras: none is plugged in.",
            "  A phone is a camera, too: let an app serve its picture over the network, and write",
            '  driver = "url" and its address into the bench file.',
        ]
    lines = ["Cameras:"]
    for camera in cameras:
        lines.append(f"  {camera.device}")
        told = [camera.path if camera.path != str(camera.device) else "", camera.name, _usb(camera.usb_id)]
        if camera.serial_number:
            told.append(f"serial number {camera.serial_number}")
        lines += _detail(", ".join(word for word in told if word))
        if camera.is_built_in:
            lines += _detail("Probably the computer's own, not the scanner's.")
        lines += _detail(camera.problem)
    return lines


def _detail(text: str) -> list[str]:
    return [f"      {text}"] if text else []


def _usb(usb_id: tuple[int, int] | None) -> str:
    return "" if usb_id is None else f"USB {usb_id[0]:04x}:{usb_id[1]:04x}"


def _check_new(path: Path) -> None:
    check_output(path)
    if path.exists():
        raise OutputError(str(path), "is there already", "Name another file, or take this one away.")


def _write(path: Path, boards: Sequence[_Board], cameras: Sequence[FoundCamera]) -> None:
    """Draft a bench of the first board and the first camera that is not the computer's own.

    Raises:
        BenchFileError: there is neither.
    """
    usable = [camera for camera in cameras if not camera.is_built_in] or list(cameras)
    if not boards and not usable:
        raise BenchFileError(
            str(path),
            "is not written: no board was recognised and no camera found",
            "Plug them in, or try everything without: `turnscan scan OUT --bench simulated`.",
        )
    turntable: dict[str, object] = {"driver": "manual"}
    lasers: Sequence[LaserChoice] = ()
    if boards and boards[0].identity is not None:
        identity = boards[0].identity
        turntable = {"driver": identity.driver, "port": boards[0].port.stable_name, **identity.options}
        lasers = LASERS.get(identity.driver, ())
    camera: dict[str, object] = {"driver": "uvc", "device": usable[0].device if usable else 0}
    write_bench_file(path, draft_bench(turntable, camera, lasers))
    say([f"{path}: a first bench file. Look through it, then run `turnscan doctor --bench {path}`."])
    warn(_doubts(boards, usable))


def _doubts(boards: Sequence[_Board], cameras: Sequence[FoundCamera]) -> list[str]:
    doubts = []
    if not boards:
        doubts.append(
            'No board was recognised; the file says that a person turns the table (driver "manual").'
        )
    if len(boards) > 1:
        doubts.append(f"Of {len(boards)} boards the file names the first, {boards[0].port.stable_name}.")
    if not cameras:
        doubts.append("No camera was found; the file names the first that will be plugged in.")
    elif cameras[0].is_built_in:
        doubts.append("The only camera is probably the computer's own; put the scanner's into the file.")
    elif len(cameras) > 1:
        doubts.append(f"Of {len(cameras)} cameras the file names the first, {cameras[0].name}.")
    return doubts
