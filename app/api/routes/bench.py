"""The bench: how it stands, and moving it by hand."""

from typing import Annotated

from fastapi import APIRouter, Path
from pydantic import BaseModel, Field

from app.api.services import Served
from app.devices.bench import BenchSnapshot
from app.jobs.events import BenchChanged

router = APIRouter(prefix="/bench", tags=["bench"])
_BY_HAND = "moving it by hand"


class CameraOut(BaseModel):
    """The camera.

    Attributes:
        connected: whether pictures come.
        frozen: whether it has gone silent.
        fps: pictures per second, as measured.
        lost: pictures that did not come, or damaged.
        problem: what went wrong last.
    """

    connected: bool
    frozen: bool
    fps: float
    lost: int
    problem: str


class BenchOut(BaseModel):
    """The bench.

    Attributes:
        turntable: what the board says of itself; empty while it is not connected.
        angle_deg: where the table stands, as far as is known.
        lasers: all there are.
        lasers_on: those that are lit.
        holder: what holds the bench; empty for nothing.
        problems: what is wrong now, as sentences.
    """

    name: str
    turntable: str
    angle_deg: float
    lasers: list[str]
    lasers_on: list[str]
    camera: CameraOut
    holder: str
    problems: list[str]


class Switch(BaseModel):
    """On or off."""

    on: bool


class Move(BaseModel):
    """Where to turn the table, in degrees as the board counts."""

    angle_deg: Annotated[float, Field(ge=-3600.0, le=3600.0)]


@router.get("")
def show_bench(served: Served) -> BenchOut:
    """How the bench stands."""
    return _shown(served, served.bench.snapshot())


@router.post("/connect")
def connect_bench(served: Served) -> BenchOut:
    """Connect what is not connected."""
    served.bench.connect()
    return _changed(served)


@router.post("/stop")
def stop_bench(served: Served) -> BenchOut:
    """Emergency stop: lasers off, table stopped, whoever holds the bench."""
    served.bench.make_safe()
    return _changed(served)


@router.post("/lasers/{name}")
def switch_laser(served: Served, name: Annotated[str, Path(max_length=200)], switch: Switch) -> BenchOut:
    """Switch a laser while no job holds the bench."""
    served.bench.refuse_held(_BY_HAND)
    served.bench.switch(name, switch.on)
    return _changed(served)


@router.post("/table")
def turn_table(served: Served, move: Move) -> BenchOut:
    """Turn the table while no job holds the bench; answered when it stands still. Lasers stay as they are."""
    served.bench.refuse_held(_BY_HAND)
    served.bench.turntable.move_to(move.angle_deg)
    return _changed(served)


def _changed(served: Served) -> BenchOut:
    served.runner.bus.publish(BenchChanged())
    return _shown(served, served.bench.snapshot())


def _shown(served: Served, snapshot: BenchSnapshot) -> BenchOut:
    camera = snapshot.camera
    return BenchOut(
        name=snapshot.name,
        turntable=snapshot.turntable,
        angle_deg=snapshot.angle_deg,
        lasers=list(served.bench.lasers),
        lasers_on=list(snapshot.lasers_on),
        camera=CameraOut(
            connected=camera.is_connected,
            frozen=camera.is_frozen,
            fps=camera.fps,
            lost=camera.lost,
            problem=camera.last_error,
        ),
        holder=snapshot.holder,
        problems=list(snapshot.problems),
    )
