"""What is plugged in, and which of it makes the bench."""

from typing import Annotated, Any, Literal

from fastapi import APIRouter
from pydantic import BaseModel, Field

from app.api.bench_out import BenchOut, shown_bench
from app.api.services import Served
from app.devices.bench_file import LaserChoice, simulated_description
from app.devices.camera_listing import FoundCamera, found_cameras
from app.devices.identify import identify
from app.devices.ports import SerialPort, serial_ports
from app.devices.presets import PRESETS, bench_text
from app.errors import NotThere, OptionError

router = APIRouter(prefix="/devices", tags=["devices"])
Text = Annotated[str, Field(min_length=1, max_length=300)]
Board = Literal["horus", "fabscan", "fabscan100", "grbl", "marlin", "sardauscan", "manual", "simulated"]
Camera = Literal["uvc", "picamera", "url", "simulated"]


class FoundCameraOut(BaseModel):
    """A camera; see `FoundCamera`."""

    device: str
    path: str
    name: str
    usb_id: str
    serial_number: str
    is_built_in: bool
    problem: str


class PortOut(BaseModel):
    """A port that may have a board; see `SerialPort`. `in_use` is the one of the bench."""

    name: str
    path: str
    description: str
    usb_id: str
    serial_number: str
    problem: str
    in_use: bool


class PresetOut(BaseModel):
    """A kind of scanner; see `Preset`."""

    name: str
    title: str
    board: Board
    camera: Camera
    note: str


class DevicesOut(BaseModel):
    """What is there, and what can be chosen; `bench` names the bench in use."""

    cameras: list[FoundCameraOut]
    ports: list[PortOut]
    presets: list[PresetOut]
    bench: str


class PortIn(BaseModel):
    """A port, by its lasting name or its path, as listed."""

    port: Text


class IdentityOut(BaseModel):
    """What is behind a port; `board` is empty where it is none that is known here."""

    board: str
    firmware: str
    baud: int
    notes: list[str]
    options: dict[str, Any]


class LaserIn(BaseModel):
    """A laser at an output of the board."""

    name: Annotated[str, Field(min_length=1, max_length=60, pattern=r"^[\w -]+$")]
    channel: Annotated[int, Field(ge=0, le=1000)]
    colour: Literal["red", "green", "blue", "any"] = "red"


class ChoiceIn(BaseModel):
    """A bench.

    Attributes:
        name: what people call it.
        board: driver of the board.
        port: where it is, as listed; none for one without.
        baud: its rate where it is not the usual one.
        camera: driver of the camera.
        device: of a camera with the driver `uvc`, as listed; the address of one with `url`.
        lasers: as usual for the board where none is named.
    """

    name: Annotated[str, Field(min_length=1, max_length=100)] = "bench"
    board: Board
    port: Text | None = None
    baud: Annotated[int, Field(ge=300, le=4_000_000)] | None = None
    direction: Literal["ccw", "cw"] = "ccw"
    camera: Camera
    device: Text | None = None
    rotation: Literal[0, 90, 180, 270] = 0
    mirror: bool = False
    lasers: Annotated[list[LaserIn], Field(max_length=8)] = []


class ChosenOut(BaseModel):
    """The bench that is in use now; `problem` is why a device of it does not work yet, empty for nothing."""

    bench: BenchOut
    problem: str


@router.get("")
def list_devices(served: Served) -> DevicesOut:
    """Cameras and ports under names that last. No port is opened."""
    used = served.bench.turntable.facts.port if served.bench.turntable.is_connected else ""
    return DevicesOut(
        cameras=[_camera_out(camera) for camera in found_cameras()],
        ports=[_port_out(port, used) for port in serial_ports()],
        presets=[PresetOut.model_validate(preset, from_attributes=True) for preset in PRESETS],
        bench=served.choice.spec,
    )


@router.post("/identify")
def identify_board(wanted: PortIn) -> IdentityOut:
    """Listen to what is behind a port; takes some seconds. No laser is switched and no table moved."""
    port = _listed(wanted.port)
    found = identify(port.path, port.usb_id)
    return IdentityOut(
        board=found.driver, firmware=found.firmware, baud=found.baud, notes=list(found.notes),
        options=dict(found.options),
    )  # fmt: skip


@router.post("/choose")
def choose_bench(served: Served, wanted: ChoiceIn) -> ChosenOut:
    """Take another bench, while no job holds the one in use. The server's folder keeps it as bench.toml."""
    if wanted.board == wanted.camera == "simulated":
        problem = served.choice.choose_simulated(simulated_description())
        return ChosenOut(bench=shown_bench(served.bench), problem=problem)
    turntable: dict[str, Any] = {"driver": wanted.board}
    if wanted.board not in ("manual", "simulated"):
        if wanted.port is None:
            raise OptionError(f"port: the board {wanted.board!r} needs one.", "Choose one of those listed.")
        turntable["port"] = _listed(wanted.port).stable_name
        if wanted.baud is not None:
            turntable["baud"] = wanted.baud
    text = bench_text(
        wanted.name, turntable, _camera(wanted),
        [LaserChoice(laser.name, laser.channel, laser.colour) for laser in wanted.lasers],
        direction=wanted.direction, rotation=wanted.rotation, is_mirrored=wanted.mirror,
    )  # fmt: skip
    return ChosenOut(problem=served.choice.choose(text), bench=shown_bench(served.bench))


def _camera(wanted: ChoiceIn) -> dict[str, Any]:
    camera: dict[str, Any] = {"driver": wanted.camera}
    if wanted.camera == "uvc":
        there = {str(camera.device): camera.device for camera in found_cameras()}
        if wanted.device not in there:
            raise NotThere(f"No camera is called {wanted.device!r}.", "Choose one of those listed.")
        camera["device"] = there[wanted.device]
    if wanted.camera == "url":
        if wanted.device is None or not wanted.device.startswith(("http://", "https://", "rtsp://")):
            raise OptionError("device: is no address of a camera.", "Give one that begins with http://.")
        camera["url"] = wanted.device
    return camera


def _listed(name: str) -> SerialPort:
    for port in serial_ports():
        if name in (port.stable_name, port.path):
            return port
    raise NotThere(f"There is no port {name!r}.", "Choose one of those listed.")


def _camera_out(camera: FoundCamera) -> FoundCameraOut:
    return FoundCameraOut(
        device=str(camera.device), path=camera.path, name=camera.name, usb_id=_usb(camera.usb_id),
        serial_number=camera.serial_number, is_built_in=camera.is_built_in, problem=camera.problem,
    )  # fmt: skip


def _port_out(port: SerialPort, used: str) -> PortOut:
    return PortOut(
        name=port.stable_name, path=port.path, description=port.description, usb_id=_usb(port.usb_id),
        serial_number=port.serial_number, problem=port.problem,
        in_use=used in (port.path, port.stable_name),
    )  # fmt: skip


def _usb(usb_id: tuple[int, int] | None) -> str:
    return "" if usb_id is None else f"{usb_id[0]:04x}:{usb_id[1]:04x}"
