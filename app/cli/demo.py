"""`turnscan demo`: the whole chain on a simulated scanner, from pictures to a cloud."""

from pathlib import Path
from typing import Annotated

import typer

from app.cli.calibrate import calibrate_command
from app.cli.console import say
from app.cli.reconstruct import reconstruct_command
from app.cli.simulate import simulate_command
from app.recording.reader import Recording


def demo_command(
    out: Annotated[Path, typer.Argument(help="Folder for everything that is made.")] = Path("out"),
    item: Annotated[str, typer.Option("--object", help="As for simulate.")] = "mug",
    steps: Annotated[int, typer.Option(min=1, help="Stops in one turn.")] = 200,
) -> int:
    """Simulate a scanner, calibrate it from its pictures, and reconstruct what stands on its table."""
    recording = out / f"{item}-{steps}"
    if not (recording / "recording.json").is_file():
        say([f"1/3  Simulating a scan of a {item}."])
        simulate_command(recording, item=item, steps=steps)
    Recording.open(recording)
    say(["2/3  Calibrating the scanner from its own pictures."])
    calibration = out / "calibration.json"
    doubtful = calibrate_command([recording], calibration)
    say(["3/3  Reconstructing."])
    cloud = out / f"{item}.ply"
    doubtful = reconstruct_command(recording, cloud, calibration) or doubtful
    say([f"Look at {cloud.with_suffix('.png')}; open {cloud} in any 3D viewer, such as MeshLab."])
    return doubtful
