"""`turnscan calibrate`: recordings or a bench in, a calibration file and a report out."""

from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from app.calibration.calibrate import calibrate
from app.calibration.camera_file import load_camera
from app.calibration.outcome import CalibrationOutcome
from app.calibration.plan import CalibrationPlan
from app.calibration.report import check_report_name, report_lines, write_report
from app.calibration.store import STORE, CalibrationStore
from app.cli.calibrate_bench import BenchCalibration, show_proof
from app.cli.console import check_output, progress_bar, say, warn
from app.errors import OptionError
from app.jobs.calibrate_solve import with_findings
from app.jobs.table_height import with_table
from app.recording.reader import Recording
from app.vision.stripe import STRIPE_DETECTORS, StripeDetector

_DOUBTFUL = 1


class _Method(StrEnum):
    JOINT = "joint"
    PAPER = "paper"


class _Axis(StrEnum):
    AUTO = "auto"
    LINE = "line"
    BOARD = "board"
    PLATTER = "platter"


def calibrate_command(
    recordings: Annotated[
        list[Path] | None,
        typer.Argument(
            help="One or more recordings of the same rig; with --bench, the folder for the new one.",
            show_default=False,
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="The file; by default a dated one in calibration_store."),
    ] = None,
    method: Annotated[
        _Method, typer.Option(help="joint: everything in one adjustment. paper: step by step, as Rui Wang.")
    ] = _Method.JOINT,
    axis: Annotated[_Axis, typer.Option(help="How the paper's method finds the axis.")] = _Axis.AUTO,
    intrinsics: Annotated[
        Path | None,
        typer.Option(help="A calibration file, or OpenCV's YAML or XML, whose camera is taken as it is."),
    ] = None,
    detector: Annotated[
        str, typer.Option(help="Stripe detector; by default zero-crossing, or threshold for the paper.")
    ] = "",
    report: Annotated[
        Path | None, typer.Option(help="A .html or .png report; by default HTML beside the output.")
    ] = None,
    no_distortion: Annotated[
        bool, typer.Option("--no-distortion", help="With paper: leave the lens distortion out, as it does.")
    ] = False,
    skip_bad_frames: Annotated[
        bool, typer.Option("--skip-bad-frames", help="Go on without pictures that cannot be read.")
    ] = False,
    bench: Annotated[
        str | None,
        typer.Option(help="Take the pictures on this bench: its file, or simulated, or simulated:grbl."),
    ] = None,
    known_camera: Annotated[
        Path | None,
        typer.Option(
            "--camera", help="With --bench: as --intrinsics; the camera's views are then not taken."
        ),
    ] = None,
    board: Annotated[
        str, typer.Option(help="With --bench: the board, such as chessboard:11x8:12; else its bench file's.")
    ] = "",
    resume: Annotated[
        bool, typer.Option("--resume", help="With --bench: go on with pictures that ended early.")
    ] = False,
    patience: Annotated[
        float, typer.Option(min=0.0, help="With --bench: seconds to wait for a device that has gone away.")
    ] = 60.0,
) -> int:
    """Calibrate camera, laser planes and axis, from recordings or on the bench itself."""
    if bench is None and (board or resume or known_camera):
        raise OptionError(
            "--board, --camera and --resume only go with --bench.", "For a known camera, say --intrinsics."
        )
    if bench is not None and method is not _Method.JOINT:
        raise OptionError("--bench only goes with the joint method.")
    if no_distortion and method is not _Method.PAPER:
        raise OptionError("--no-distortion only goes with --method paper.")
    if axis is not _Axis.AUTO and method is not _Method.PAPER:
        raise OptionError(
            "--axis only goes with --method paper: the joint method uses all that was recorded."
        )
    name = detector or ("threshold" if method is _Method.PAPER else "zero-crossing")
    file = intrinsics or known_camera
    camera = None if file is None else load_camera(file)
    plan = CalibrationPlan(method.value, axis.value, camera, not no_distortion, skip_bad_frames)
    for path in (output, report):
        if path is not None:
            check_output(path)
    if report is not None:
        check_report_name(report)
    finder = STRIPE_DETECTORS.make(name)
    if bench is not None:
        job = BenchCalibration(bench, _one_folder(recordings), board, resume, patience, finder, plan)
        outcome, proof = job.run()
    else:
        outcome, proof = _from_recordings(recordings or [], finder, plan), None
    if output is None:
        output = CalibrationStore(STORE).save(outcome.record)
    else:
        outcome.record.save(output)
    written = report if report is not None else output.with_suffix(".html")
    write_report(with_findings(outcome, proof), written)
    say(report_lines(outcome))
    if proof is not None:
        show_proof(proof)
    warn(outcome.notes)
    warn(outcome.doubts, is_doubt=True)
    say([f"Calibration in {output}, report in {written}."])
    return _DOUBTFUL if outcome.doubts else 0


def _from_recordings(
    recordings: list[Path], finder: StripeDetector, plan: CalibrationPlan
) -> CalibrationOutcome:
    if not recordings:
        raise OptionError(
            "Nothing is named to calibrate from.",
            "Name one or more recordings, or take the pictures with `turnscan calibrate --bench bench.toml`.",
        )
    opened = [Recording.open(path) for path in recordings]
    with progress_bar() as show:
        outcome = calibrate(opened, finder, plan, show)
        return replace(outcome, record=with_table(outcome.record, opened, show))


def _one_folder(recordings: list[Path] | None) -> Path | None:
    if recordings is not None and len(recordings) > 1:
        raise OptionError("With --bench, one folder for the new pictures is enough.")
    return recordings[0] if recordings else None
