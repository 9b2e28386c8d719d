"""The bench as it goes out."""

from pydantic import BaseModel

from app.devices.bench import Bench


class CameraOut(BaseModel):
    """The camera.

    Attributes:
        connected: whether pictures come.
        frozen: whether it has gone silent.
        fps: pictures per second, as measured.
        lost: pictures that did not come, or damaged.
        problem: what went wrong last.
        size: width and height of upright pictures; None while it has never been connected.
        name: what it calls itself; empty while it has never been connected.
    """

    connected: bool
    frozen: bool
    fps: float
    lost: int
    problem: str
    size: tuple[int, int] | None
    name: str


class LaserOut(BaseModel):
    """A laser of the bench."""

    name: str
    colour: str
    channel: int


class TableOut(BaseModel):
    """What the board can do; known once it is connected.

    Attributes:
        driver: that speaks with it.
        port: where it is.
        smallest_deg: the smallest turn it makes.
        slowest_deg_s, fastest_deg_s: speeds of a steady turn; None for a fastest that nobody knows.
        can_turn_steadily: whether it can be asked for a speed.
        can_stop: whether a move can be stopped.
        turns_by_itself: it turns all the time, and cannot be sent anywhere.
        lasers_by_hand: a person switches the lasers.
    """

    driver: str
    port: str
    smallest_deg: float
    slowest_deg_s: float
    fastest_deg_s: float | None
    can_turn_steadily: bool
    can_stop: bool
    turns_by_itself: bool
    lasers_by_hand: bool


class BenchOut(BaseModel):
    """The bench.

    Attributes:
        simulated: whether a device of it is.
        turntable: what the board says of itself; empty while it is not connected.
        table: what it can do; None while it is not connected.
        angle_deg: where the table stands, as far as is known.
        placed: whether it is known where the table stands; otherwise zero it.
        lasers: names of all there are.
        laser_facts: the same with their colours.
        lasers_on: those that are lit.
        holder: what holds the bench; empty for nothing.
        problems: what is wrong now, as sentences.
    """

    name: str
    simulated: bool
    turntable: str
    table: TableOut | None
    angle_deg: float
    placed: bool
    lasers: list[str]
    laser_facts: list[LaserOut]
    lasers_on: list[str]
    camera: CameraOut
    holder: str
    problems: list[str]


def shown_bench(bench: Bench) -> BenchOut:
    """How it stands now; never waits for a device."""
    snapshot, description = bench.snapshot(), bench.description
    camera = snapshot.camera
    facts = bench.camera.facts if camera.is_connected else None
    return BenchOut(
        name=snapshot.name,
        simulated=description.is_simulated,
        turntable=snapshot.turntable,
        table=_table(bench) if snapshot.turntable else None,
        angle_deg=snapshot.angle_deg,
        placed=bench.is_placed,
        lasers=list(bench.lasers),
        laser_facts=[
            LaserOut(name=name, colour=entry.colour, channel=entry.channel)
            for name, entry in bench.lasers.items()
        ],
        lasers_on=list(snapshot.lasers_on),
        camera=CameraOut(
            connected=camera.is_connected,
            frozen=camera.is_frozen,
            fps=camera.fps,
            lost=camera.lost,
            problem=camera.last_error,
            size=None if facts is None else facts.size,
            name="" if facts is None else facts.name,
        ),
        holder=snapshot.holder,
        problems=list(snapshot.problems),
    )


def _table(bench: Bench) -> TableOut:
    facts = bench.turntable.facts
    fastest = facts.fastest_deg_s
    return TableOut(
        driver=bench.description.turntable.driver,
        port=facts.port,
        smallest_deg=facts.smallest_deg,
        slowest_deg_s=facts.slowest_deg_s,
        fastest_deg_s=fastest if fastest < float("inf") else None,
        can_turn_steadily=facts.can_turn_steadily,
        can_stop=facts.can_stop,
        turns_by_itself=facts.turns_by_itself,
        lasers_by_hand=facts.lasers_by_hand,
    )
