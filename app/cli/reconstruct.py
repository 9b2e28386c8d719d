"""`turnscan reconstruct`: a recording and its calibration in, a cloud out."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from app.calibration.platter_file import layout_of
from app.calibration.record import CalibrationRecord
from app.calibration.store import STORE, CalibrationStore
from app.cli.console import check_output, progress_bar, say, warn
from app.cli.reconstruction_lines import reconstruction_lines
from app.errors import OptionError
from app.recording.reader import Recording
from app.scanning.drift import DriftReference
from app.scanning.reconstruct import ReconstructionOptions
from app.scanning.sources import reconstruct_recording, scan_detector
from app.surface.ply import PlyWriter
from app.surface.preview import PreviewPainter

_STREAM = Path("-")
_DOUBTFUL = 1


def reconstruct_command(
    recording: Annotated[Path, typer.Argument(help="A recording with scan frames.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The PLY file; - for standard output.")],
    calibration: Annotated[
        Path | None,
        typer.Option("-c", "--calibration", help="Its file; by default the one in use in calibration_store."),
    ] = None,
    ascii_text: Annotated[bool, typer.Option("--ascii", help="Write the PLY as text.")] = False,
    preview: Annotated[
        Path | None, typer.Option(help="PNG of the cloud from three sides; by default beside the output.")
    ] = None,
    detector: Annotated[str, typer.Option(help="Stripe detector.")] = "zero-crossing",
    radius: Annotated[float | None, typer.Option(help="Keep points so near to the axis, mm.")] = None,
    above: Annotated[float | None, typer.Option(help="Keep points above this height, mm.")] = None,
    below: Annotated[float | None, typer.Option(help="Keep points below this height, mm.")] = None,
    min_quality: Annotated[
        float, typer.Option(min=0.0, max=1.0, help="Keep points of this quality, 0 to 1.")
    ] = 0.0,
    no_markers: Annotated[
        bool, typer.Option("--no-markers", help="Do not read the angle from markers on the table.")
    ] = False,
    skip_bad_frames: Annotated[
        bool, typer.Option("--skip-bad-frames", help="Go on without stops whose pictures cannot be read.")
    ] = False,
) -> int:
    """Turn a recording into a point cloud."""
    if output != _STREAM and output.suffix.lower() != ".ply":
        raise OptionError(f"{output}: a cloud is written as .ply.", "Name a .ply file, or - for a stream.")
    picture = preview if preview is not None or output == _STREAM else output.with_suffix(".png")
    for path in (output, picture):
        if path is not None and path != _STREAM:
            check_output(path)
    record = CalibrationStore(STORE).current() if calibration is None else CalibrationRecord.load(calibration)
    if calibration is None:
        say([f"Calibration      {record.source}"])
    rig = record.rig
    options = ReconstructionOptions(
        radius_mm=radius,
        above_mm=above,
        below_mm=below,
        min_quality=min_quality,
        uses_markers=not no_markers,
        skips_bad_frames=skip_bad_frames,
    )
    run = reconstruct_recording(
        Recording.open(recording),
        rig,
        scan_detector(detector),
        options,
        layout_of(record) or None,
        DriftReference.kept_in(record.extra),
    )
    painter = PreviewPainter()
    target = sys.stdout.buffer if output == _STREAM else output
    with progress_bar() as show, PlyWriter(target, run.laser_names, ascii_text=ascii_text) as ply:
        for number, profile in enumerate(run, start=1):
            ply.append(profile.cloud)
            painter.add(profile.cloud)
            show("Reconstructing", number, max(run.total, number), f"{ply.points:,} points")
    if picture is not None:
        painter.write(picture)
    report = run.report()
    say(reconstruction_lines(report))
    warn(report.warnings)
    warn(report.doubts, is_doubt=True)
    say([f"Cloud in {output}" + (f", picture in {picture}." if picture is not None else ".")])
    return _DOUBTFUL if report.doubts else 0
