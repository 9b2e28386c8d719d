"""What stands before the camera of a simulated bench: what hands would do on a real one."""

from enum import StrEnum

from fastapi import APIRouter
from pydantic import BaseModel

from app.api.services import Served, Services
from app.errors import OptionError
from app.simulation.world import SimulatedWorld

router = APIRouter(prefix="/bench/simulated", tags=["bench"])


class Standing(StrEnum):
    """What can be there: the object, also on its side; the board in two places, or held in hands."""

    OBJECT = "object"
    LYING = "object-lying"
    NOTHING = "nothing"
    BOARD = "board"
    BOARD_AGAIN = "board-again"
    HELD = "held"
    HELD_ACROSS = "held-across"


class StageOut(BaseModel):
    """What stands there."""

    stage: Standing


@router.get("/stage")
def show_stage(served: Served) -> StageOut:
    """What stands before the camera."""
    thing, placement = _world(served).standing
    if thing == "board-on-table":
        return StageOut(stage=Standing.BOARD if placement % 2 == 0 else Standing.BOARD_AGAIN)
    return StageOut(stage=Standing.HELD if thing == "board-in-hands" else Standing(thing))


@router.post("/stage")
def set_stage(served: Served, wanted: StageOut) -> StageOut:
    """Put something there, at any time, also while a calibration waits for it."""
    world = _world(served)
    if wanted.stage is Standing.BOARD:
        world.place_board(0)
    elif wanted.stage is Standing.BOARD_AGAIN:
        world.place_board(1)
    elif wanted.stage in (Standing.HELD, Standing.HELD_ACROSS):
        world.hold_board(across_lasers=wanted.stage is Standing.HELD_ACROSS)
    elif wanted.stage is Standing.LYING:
        world.put("object-lying")
    else:
        world.put("object" if wanted.stage is Standing.OBJECT else "nothing")
    return show_stage(served)


def _world(served: Services) -> SimulatedWorld:
    if served.bench.world is None:
        raise OptionError("This bench is not simulated.", "Put things before its camera by hand.")
    return served.bench.world
