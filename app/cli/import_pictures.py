"""`turnscan import`: a recording from pictures or a video that somebody took."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from app.cli.console import progress_bar, say
from app.cli.words import board_from, lasers_from, platter_from
from app.recording.import_frames import import_pictures
from app.recording.import_plan import ImportPlan
from app.recording.reader import Recording
from app.recording.shot import Role


class _Order(StrEnum):
    NAME = "name"
    TIME = "time"


class _Direction(StrEnum):
    CCW = "ccw"
    CW = "cw"


def import_command(
    source: Annotated[Path, typer.Argument(help="A folder of PNG or JPEG pictures, or a video.")],
    out: Annotated[Path, typer.Argument(help="Folder of the new recording.")],
    role: Annotated[Role, typer.Option(help="What the pictures are for.")] = Role.SCAN,
    laser: Annotated[
        list[str] | None, typer.Option(help="A laser as NAME:COLOUR, such as left:red; repeat for more.")
    ] = None,
    pattern: Annotated[
        str, typer.Option(help="Lasers lit in turn at each stop, such as left,right,off; + joins lasers.")
    ] = "",
    step: Annotated[float | None, typer.Option(help="Degrees from stop to stop.")] = None,
    turns: Annotated[float | None, typer.Option(help="Turns that all pictures together show.")] = None,
    seconds_per_turn: Annotated[float | None, typer.Option(help="Of a video.")] = None,
    start: Annotated[float, typer.Option(help="Angle of the first picture, degrees.")] = 0.0,
    direction: Annotated[
        _Direction | None, typer.Option(help="Which way the table turns, seen from above.")
    ] = None,
    order: Annotated[_Order, typer.Option(help="Order of the pictures in a folder.")] = _Order.NAME,
    every: Annotated[int, typer.Option(min=1, help="Take one stop of so many.")] = 1,
    board: Annotated[str, typer.Option(help="Board in the pictures, such as chessboard:9x6:20.")] = "",
    platter: Annotated[
        str, typer.Option(help="Markers on the table, such as DICT_4X4_50:30:5,18,27,42.")
    ] = "",
    add: Annotated[bool, typer.Option("--add", help="Add to the recording that is there.")] = False,
    jpeg: Annotated[bool, typer.Option("--jpeg", help="Keep frames of a video as JPEG, not PNG.")] = False,
) -> None:
    """Make a recording of a folder of pictures or a video.

    Where nothing says how far the table turned, the length of a turn is found in the pictures.
    """
    lit = tuple(() if part == "off" else tuple(part.split("+")) for part in pattern.split(",") if part)
    lasers = lasers_from(laser or [])
    if add and not lasers and out.is_dir():
        lasers = dict(Recording.open(out).lasers)
    plan = ImportPlan(
        role=role,
        lasers=lasers,
        pattern=lit,
        step_deg=step,
        turns=turns,
        seconds_per_turn=seconds_per_turn,
        start_deg=start,
        direction=None if direction is None else direction.value,
        order=order.value,
        every=every,
        board=board_from(board) if board else None,
        platter=platter_from(platter) if platter else None,
        image_format="jpeg" if jpeg else "png",
    )
    with progress_bar() as show:
        report = import_pictures(
            source, out, plan, is_added=add, progress=lambda done, total: show("Importing", done, total)
        )
    say(report.sentences())
    say(f"Left out: {skipped}" for skipped in report.skipped)
