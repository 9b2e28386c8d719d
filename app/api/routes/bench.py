"""The bench: how it stands, and moving it by hand."""

from typing import Annotated

from fastapi import APIRouter, Path
from pydantic import BaseModel, Field, model_validator

from app.api.bench_out import BenchOut, shown_bench
from app.api.services import Served
from app.errors import DeviceRefused, OptionError
from app.jobs.events import BenchChanged

router = APIRouter(prefix="/bench", tags=["bench"])
_BY_HAND = "moving it by hand"
_CONSOLE = "the console"
Angle = Annotated[float, Field(ge=-3600.0, le=3600.0, allow_inf_nan=False)]


class Switch(BaseModel):
    """On or off."""

    on: bool


class Move(BaseModel):
    """Where to turn the table: to an angle as the board counts, or by so much; one of them.

    Attributes:
        speed_deg_s: of a turn by so much; as fast as usual where it is absent.
    """

    angle_deg: Angle | None = None
    by_deg: Angle | None = None
    speed_deg_s: Annotated[float, Field(gt=0.0, le=720.0)] | None = None

    @model_validator(mode="after")
    def _is_one(self) -> "Move":
        if (self.angle_deg is None) == (self.by_deg is None):
            raise ValueError("give angle_deg or by_deg")
        if self.speed_deg_s is not None and self.by_deg is None:
            raise ValueError("speed_deg_s goes with by_deg")
        return self


class Zero(BaseModel):
    """What the place where the table stands is called from now on."""

    angle_deg: Angle = 0.0


class Line(BaseModel):
    """A line in the board's own language.

    Attributes:
        understood: that the board does whatever it is told, and that this is the sender's own risk.
    """

    line: Annotated[str, Field(min_length=1, max_length=200, pattern=r"^[ -~]+$")]
    understood: bool = False


class AnswerOut(BaseModel):
    """What the board said, line by line."""

    lines: list[str]


@router.get("")
def show_bench(served: Served) -> BenchOut:
    """How the bench stands."""
    return shown_bench(served.bench)


@router.post("/connect")
def connect_bench(served: Served) -> BenchOut:
    """Connect what is not connected."""
    served.bench.connect()
    return _changed(served)


@router.post("/stop")
async def stop_bench(served: Served) -> BenchOut:
    """Emergency stop: lasers off, table stopped, whoever holds the bench; its job is cancelled.

    It waits for nothing and nobody: it works while other requests, a job or the camera hang. The events'
    WebSocket takes the text `stop` for the same.
    """
    await served.emergency.press()
    return shown_bench(served.bench)


@router.post("/lasers/{name}")
def switch_laser(served: Served, name: Annotated[str, Path(max_length=200)], switch: Switch) -> BenchOut:
    """Switch a laser while no job holds the bench. It goes off when nobody is there for 30 s."""
    served.bench.refuse_held(_BY_HAND)
    served.bench.switch(name, switch.on)
    return _changed(served)


@router.post("/table")
def turn_table(served: Served, move: Move) -> BenchOut:
    """Turn the table while no job holds the bench; answered when it stands still. Lasers stay as they are."""
    served.bench.refuse_held(_BY_HAND)
    table = served.bench.turntable
    if move.angle_deg is not None:
        table.move_to(move.angle_deg)
    elif move.by_deg and move.speed_deg_s is None:
        table.move_to(table.angle_deg + move.by_deg)
    elif move.by_deg and move.speed_deg_s is not None:
        table.start_turning(move.by_deg, move.speed_deg_s)
        table.finish_turning()
    return _changed(served)


@router.post("/zero")
def zero_table(served: Served, zero: Zero) -> BenchOut:
    """Say where the table stands; also after a move that nobody knows the end of."""
    served.bench.refuse_held(_BY_HAND)
    served.bench.zero(zero.angle_deg)
    return _changed(served)


@router.post("/motor")
def hold_table(served: Served, switch: Switch) -> BenchOut:
    """Hold the table with the motor's current, or let it go so that a hand can turn it."""
    served.bench.refuse_held(_BY_HAND)
    served.bench.turntable.hold(switch.on)
    return _changed(served)


@router.post("/console")
def talk_to_board(served: Served, said: Line) -> AnswerOut:
    """Send one line as it is, and hear the answer; afterwards lasers are off and the table stands.

    A board without lines of text says what it takes instead.
    """
    if not said.understood:
        raise OptionError(
            "A line goes to the board as it is, and may move the table or light a laser.",
            'Send it with "understood": true.',
        )
    bench = served.bench
    bench.refuse_held("talking to its board")
    if not bench.turntable.is_connected:
        raise DeviceRefused(bench.description.turntable.driver, "is not connected", "Connect it first.")
    # Whatever the line lit or moved, giving the bench back makes it safe.
    with bench.lease(_CONSOLE, wait_s=0.0):
        answer = bench.turntable.talk(said.line)
    served.runner.bus.publish(BenchChanged())
    return AnswerOut(lines=[line for line in answer.replace("\r", "\n").split("\n") if line])


def _changed(served: Served) -> BenchOut:
    served.runner.bus.publish(BenchChanged())
    return shown_bench(served.bench)
