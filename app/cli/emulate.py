"""`turnscan emulate`: a simulated controller board behind a pseudo-terminal, for any program to talk to."""

import contextlib
import time
from pathlib import Path
from typing import Annotated

import typer

from app.cli.console import say
from app.cli.orderly import orderly
from app.errors import OutputError
from app.simulation.clock import Clock
from app.simulation.firmware.kernel import FIRMWARES
from app.simulation.firmware.plant import Plant, PlantState, Wiring
from app.simulation.firmware.port import EmulatedPort

_LOOK_EVERY_S = 0.1
_NOTABLE_DEG = 0.01


def emulate_command(
    dialect: Annotated[str, typer.Argument(help="Which board: horus, grbl, fabscan, marlin and others.")],
    link: Annotated[Path, typer.Option(help="Where the port appears.")] = Path("turnscan-board"),
    rate: Annotated[float, typer.Option(min=0.01, help="How much faster than real its time runs.")] = 1.0,
    no_reset: Annotated[
        bool, typer.Option("--no-reset", help="Opening the port does not reset the board.")
    ] = False,
) -> None:
    """Be a controller board until Ctrl-C, and say what its motor and lasers do."""
    maker = FIRMWARES.maker(dialect)
    if link.is_symlink() or link.exists():
        raise OutputError(str(link), "is there already", "Name another place with --link.")
    steps_per_turn = float(getattr(maker, "steps_per_turn", 1.0))
    plant = Plant(Wiring(steps_per_turn))
    with (
        orderly(),
        EmulatedPort(maker(plant=plant), link, Clock(rate), resets_on_open=not no_reset) as port,
        contextlib.suppress(KeyboardInterrupt),
    ):
        say([f"A {dialect} board is at {link} ({port.path}), {port.firmware.baud} baud. Ctrl-C ends it."])
        _watch(port)


def _watch(port: EmulatedPort) -> None:
    told = PlantState(0.0, frozenset(), False, False)
    while True:
        time.sleep(_LOOK_EVERY_S)
        state = port.firmware.plant.at(port.clock.now_s())
        if abs(state.angle_deg - told.angle_deg) > _NOTABLE_DEG or state.outputs_on != told.outputs_on:
            lit = ", ".join(map(str, sorted(state.outputs_on))) or "none"
            moving = " (moving)" if state.is_moving else ""
            say([f"table at {state.angle_deg:.2f} degrees{moving}, laser outputs on: {lit}"])
            told = state
