"""`turnscan simulate`: a complete recording of a simulated scanner, with the truth beside it."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal

import typer

from app.calibration.record import CalibrationRecord
from app.cli.console import progress_bar, say
from app.cli.words import board_from, platter_from
from app.recording.simulated import simulate_recording
from app.recording.simulated_plan import AngleError, SimulationPlan, Views
from app.simulation.noise import Noise
from app.simulation.objects import make_object, object_names
from app.simulation.rig import SimulatedRig, standard_rig


class _Parts(StrEnum):
    BOTH = "both"
    CALIBRATION = "calibration"
    SCAN = "scan"


_PARTS: dict[_Parts, tuple[Literal["calibration", "scan"], ...]] = {
    _Parts.BOTH: ("calibration", "scan"),
    _Parts.CALIBRATION: ("calibration",),
    _Parts.SCAN: ("scan",),
}


class _Direction(StrEnum):
    CCW = "ccw"
    CW = "cw"


def simulate_command(
    out: Annotated[Path, typer.Argument(help="Folder of the new recording.")],
    item: Annotated[
        str, typer.Option("--object", help=f"{', '.join(object_names())}, or a mesh file (STL, OBJ, PLY).")
    ] = "mug",
    size: Annotated[float | None, typer.Option(help="Largest side of the object, mm.")] = None,
    tilt: Annotated[
        float, typer.Option(help="Tip it over by so many degrees: 90 for lying, 180 for upside down.")
    ] = 0.0,
    rig: Annotated[Path | None, typer.Option(help="A calibration file: simulate that scanner.")] = None,
    width: Annotated[int, typer.Option(help="Columns of the picture.")] = 1280,
    height: Annotated[int, typer.Option(help="Rows of the picture.")] = 720,
    parts: Annotated[_Parts, typer.Option(help="What to write.")] = _Parts.BOTH,
    steps: Annotated[int, typer.Option(min=1, help="Stops in one turn of the scan.")] = 400,
    laser: Annotated[list[str] | None, typer.Option(help="Lasers that scan; all by default.")] = None,
    texture_every: Annotated[
        int, typer.Option(min=0, help="A picture with the lasers off at every so many stops; 0 for none.")
    ] = 1,
    background_steps: Annotated[int, typer.Option(min=0, help="Stops with the empty table first.")] = 0,
    seconds_per_turn: Annotated[
        float, typer.Option(min=0.0, help="Turn steadily, with one laser, instead of stopping.")
    ] = 0.0,
    direction: Annotated[_Direction, typer.Option(help="Which way the table turns.")] = _Direction.CCW,
    board: Annotated[str, typer.Option(help="Calibration board, such as chessboard:11x8:10.")] = "",
    platter: Annotated[
        str, typer.Option(help="Markers on the table, such as DICT_4X4_50:12:0,1,2,3,4,5.")
    ] = "",
    axis_line: Annotated[
        int, typer.Option(min=0, help="Board views through the axis, for the paper's method.")
    ] = 1,
    hand_mm: Annotated[float, typer.Option(help="How exactly a hand places that board, mm.")] = 0.0,
    hand_deg: Annotated[float, typer.Option(help="The same for its tilt, degrees.")] = 0.0,
    speckle: Annotated[float, typer.Option(min=0.0, max=1.0, help="Contrast of the speckle.")] = 0.2,
    read_noise: Annotated[float, typer.Option(min=0.0, help="Read noise, grey levels.")] = 1.0,
    angle_jitter: Annotated[float, typer.Option(min=0.0, help="Error of each stop, degrees.")] = 0.02,
    lost_steps: Annotated[int, typer.Option(min=0, help="How often the motor loses a step.")] = 0,
    jpeg: Annotated[int, typer.Option(min=0, max=100, help="JPEG of this quality instead of PNG.")] = 0,
    seed: Annotated[int, typer.Option(min=0, help="Same seed, same pictures.")] = 0,
) -> None:
    """Write the recording of a simulated scanner: calibration and scan, with the truth beside them."""
    if rig is None:
        scanner = standard_rig(width, height)
    else:
        scanner = SimulatedRig.around(CalibrationRecord.load(rig).rig)
    plan = SimulationPlan(
        scanner=scanner,
        item=make_object(item, size),
        tilt_deg=tilt,
        board=board_from(board) if board else None,
        platter=platter_from(platter) if platter else None,
        parts=_PARTS[parts],
        views=Views(axis_line=axis_line, hand_mm=hand_mm, hand_deg=hand_deg),
        steps=steps,
        texture_every=texture_every,
        background_steps=background_steps,
        lasers=tuple(laser or ()),
        seconds_per_turn=seconds_per_turn,
        direction=direction.value,
        angle_error=AngleError(jitter_deg=angle_jitter, lost_steps=lost_steps),
        noise=Noise(speckle=speckle, read_grey=read_noise),
        image_format="jpeg" if jpeg else "png",
        quality=jpeg or 95,
        seed=seed,
    )
    with progress_bar() as show:
        recording = simulate_recording(out, plan, lambda done, total: show("Simulating", done, total))
    say([f"{len(recording.entries)} pictures in {out}; the truth is in {out / 'truth.json'}."])
