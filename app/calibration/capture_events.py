"""What is said while calibration pictures are taken, and what a person is asked to do."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TypeAlias

from app.calibration.capture_goals import Wish
from app.geometry.arrays import Pixels
from app.simulation.world import SimulatedWorld


class EventKind(StrEnum):
    """What happened."""

    UNSEEN = "unseen"
    MOVING = "moving"
    SEEN = "seen"
    TAKEN = "taken"
    WANTED = "wanted"
    TURNING = "turning"
    WAITING = "waiting"
    GOING_ON = "going-on"
    RATED = "rated"


@dataclass(frozen=True, eq=False, slots=True)
class CaptureEvent:
    """One thing that happened, for a terminal or a page.

    Attributes:
        kind: `unseen`, `moving` and `seen` (it stands still, but adds nothing) tell of one picture of the
            camera, `taken` of one that was kept, `wanted` what to do next, `turning` that the table looks
            for the board, `waiting` and `going-on` that a device has gone and come back, `rated` that the
            camera's views were compared with each other.
        words: a sentence or the end of one.
        stage: camera, board, proof or table.
        done: how much of the stage is done, 0..1.
        pictures: how many are on disk in this stage.
        corners: (N, 2) px where the board was seen; empty where it was not.
        view: number of the view that was taken, as `Struck` counts; None for none.
        wish: of `wanted`, what to do next.
        rms_px: of `rated`, how well each view of the camera fits, by number.
    """

    kind: EventKind
    words: str
    stage: str
    done: float
    pictures: int
    corners: Pixels
    view: int | None = None
    wish: Wish | None = None
    rms_px: Mapping[int, float] = field(default_factory=dict)


Watch: TypeAlias = Callable[[CaptureEvent], None]
"""Told everything, in the thread that takes the pictures; what it raises ends the capture in good order."""


class Task(StrEnum):
    """What only a person can do."""

    HOLD_BOARD = "hold-board"
    SHOW_LASERS = "show-lasers"
    PLACE_BOARD = "place-board"
    CLEAR_TABLE = "clear-table"


@dataclass(frozen=True, slots=True)
class Request:
    """What a person is asked to do.

    Attributes:
        task: what.
        number: of the placement, from 0.
        words: the same for people.
        problem: why it is asked for again, part of the words; empty for the first time.
    """

    task: Task
    number: int
    words: str
    problem: str = ""


Ask: TypeAlias = Callable[[Request], None]
"""Returns when it is done. Holding the board is asked for and goes on while pictures are taken."""


def simulated_hands(world: SimulatedWorld) -> Ask:
    """The person of a simulated bench."""

    def do(request: Request) -> None:
        if request.task is Task.HOLD_BOARD:
            world.hold_board()
        elif request.task in (Task.PLACE_BOARD, Task.SHOW_LASERS):
            world.place_board(request.number)
        else:
            world.put("nothing")

    return do
