"""`turnscan batch`: recordings in, things out, and a table of what became of each."""

import os
from pathlib import Path
from typing import Annotated

import typer

from app.batch.order import BatchOrder
from app.batch.result import Outcome, Result
from app.batch.run import BatchPlan, run_batch
from app.batch.table import CSV_FILE, HTML_FILE, Row
from app.calibration.record import CalibrationRecord
from app.calibration.store import STORE, CalibrationStore
from app.cli.console import ShowProgress, console, progress_bar, say, warn
from app.cli.orderly import orderly
from app.errors import CalibrationFileError, OptionError
from app.surface.finish import Finish, Preset, preset_mesh
from app.vision.stripe import STRIPE_DETECTORS

_DOUBTFUL, _NOT_DONE = 1, 2
# The bar counts in hundredths of a recording.
_PARTS = 100


def batch_command(
    recordings: Annotated[list[Path], typer.Argument(help="Folders of recordings.")],
    calibration: Annotated[
        Path | None,
        typer.Option(
            "-c",
            "--calibration",
            help="Its file, for all; by default each is calibrated from its own pictures.",
        ),
    ] = None,
    preset: Annotated[Preset, typer.Option(help="What the things are wanted for.")] = Preset.PRINT,
    out: Annotated[Path, typer.Option(help="Folder for everything that is made.")] = Path("things"),
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes at once; by default one for two processors.")
    ] = None,
    scheduler: Annotated[
        str, typer.Option(help="Work on this Dask cluster instead, such as tcp://host:8786.")
    ] = "",
    again: Annotated[bool, typer.Option("--again", help="Make also what is done already.")] = False,
    detail: Annotated[
        float | None, typer.Option(help="Size of the finest detail, mm; by default as fine as the points.")
    ] = None,
    detector: Annotated[str, typer.Option(help="Stripe detector.")] = "zero-crossing",
    skip_bad_frames: Annotated[
        bool, typer.Option("--skip-bad-frames", help="Go on without pictures that cannot be read.")
    ] = False,
) -> int:
    """Calibrate, reconstruct and finish many recordings; what is done already is not done again."""
    if workers is not None and scheduler:
        raise OptionError("--workers and --scheduler contradict each other: the cluster has its own workers.")
    STRIPE_DETECTORS.make(detector)
    if calibration is not None:
        CalibrationRecord.load(calibration)
    order = BatchOrder(
        finish=_finish(preset, detail),
        calibration="" if calibration is None else str(calibration.resolve()),
        fallback=_in_use(),
        detector=detector,
        skips_bad_frames=skip_bad_frames,
    )
    plan = BatchPlan(order, out, workers or max(1, (os.cpu_count() or 1) // 2), scheduler, again)
    with orderly():
        try:
            with progress_bar() as show:
                rows = run_batch(recordings, plan, _Teller(show))
        except KeyboardInterrupt:
            console.print(
                "[bold red]Stopped[/] before the end. What is done is kept; the same command goes on.",
                soft_wrap=True,
            )
            return _NOT_DONE
    say(_lines(rows, out))
    outcomes = {row.outcome for row in rows}
    if Outcome.FAILED in outcomes:
        return _NOT_DONE
    return _DOUBTFUL if Outcome.DOUBTFUL in outcomes else 0


class _Teller:
    """Says on the terminal how a batch goes."""

    def __init__(self, show: ShowProgress) -> None:
        self._show, self._waiting, self._ended = show, 0, 0
        self._shares: dict[str, float] = {}

    def found(self, kept: int, waiting: int) -> None:
        self._waiting = waiting
        if kept:
            say([f"{kept} {_recordings(kept)} done already, with these settings; --again makes them anew."])

    def going(self, name: str, words: str, share: float) -> None:
        self._shares[name] = share
        self._tell(f"{name}: {words}")

    def ended(self, name: str, result: Result) -> None:
        self._shares.pop(name, None)
        self._ended += 1
        self._tell("")
        if result.outcome is Outcome.FAILED:
            console.print("Failed:", style="bold red", end=" ", soft_wrap=True)
            say([f"{name}: {result.failure}"])
        else:
            say([f"Made             {name}: {result.triangles or 0:,} triangles in {result.seconds:.0f} s"])
            warn([f"{name}: {doubt}" for doubt in result.doubts], is_doubt=True)

    def _tell(self, note: str) -> None:
        done = round(_PARTS * (self._ended + sum(self._shares.values())))
        self._show("Making things", done, _PARTS * self._waiting, note)


def _finish(preset: Preset, detail: float | None) -> Finish:
    if detail is None:
        return Finish(preset=preset)
    try:
        mesh = type(preset_mesh(preset)).model_validate(
            preset_mesh(preset).model_dump() | {"cell_mm": detail}
        )
    except ValueError:
        raise OptionError(f"--detail cannot be {detail}.") from None
    return Finish(preset=preset, mesh=mesh)


def _in_use() -> str:
    """The calibration that is in use where the command runs; empty where there is none."""
    try:
        return str(CalibrationStore(STORE).current_path().resolve())
    except CalibrationFileError:
        return ""


def _lines(rows: list[Row], out: Path) -> list[str]:
    counts = {outcome: sum(row.outcome == outcome for row in rows) for outcome in Outcome}
    told = ", ".join(f"{count} {outcome}" for outcome, count in counts.items() if count)
    return [f"{len(rows)} {'recording' if len(rows) == 1 else 'recordings'}: {told}.",
            f"Table in {out / HTML_FILE} and {out / CSV_FILE}."]  # fmt: skip


def _recordings(count: int) -> str:
    return "recording is" if count == 1 else "recordings are"
