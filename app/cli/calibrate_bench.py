"""`turnscan calibrate --bench`: takes the pictures, calibrates, and tries the calibration on the board."""

import contextlib
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from rich.table import Table

from app.calibration.capture import Captured, CapturePlan, capture
from app.calibration.capture_events import CaptureEvent, EventKind, Request, Task, simulated_hands
from app.calibration.capture_session import CaptureSession
from app.calibration.outcome import CalibrationOutcome
from app.calibration.plan import CalibrationPlan
from app.calibration.proof import Proof, Verdict
from app.calibration.store import STORE
from app.cli.bench import bench_description
from app.cli.console import ShowProgress, console, progress_bar, say
from app.cli.orderly import orderly
from app.cli.words import board_from
from app.devices.bench import Bench
from app.errors import BenchFileError, OptionError, PositionUnknown
from app.jobs.calibrate_solve import solve_captured
from app.recording.reader import Recording
from app.vision.board import BoardSpec
from app.vision.stripe import StripeDetector

_MARKS = {
    Verdict.GOOD: ("[green]good[/]", "green"),
    Verdict.FAIR: ("[yellow]fair[/]", "yellow"),
    Verdict.BAD: ("[bold red]bad[/]", "red"),
}
_STAGES = {
    "camera": "Camera views",
    "board": "Board on the table",
    "proof": "Proof",
    "table": "Empty table",
}


@dataclass(frozen=True, eq=False, slots=True)
class BenchCalibration:
    """A calibration on the bench.

    Attributes:
        bench: what `--bench` says.
        out: folder of the pictures; None for a dated one in the store of calibrations.
        board: what `--board` says; empty for that of the bench file.
        resumes: go on with the pictures in `out`.
        patience_s: how long to wait for a device that has gone away.
        detector: finds the stripes.
        plan: how to calibrate; with a camera, its views are not taken.
    """

    bench: str
    out: Path | None
    board: str
    resumes: bool
    patience_s: float
    detector: StripeDetector
    plan: CalibrationPlan

    def run(self) -> tuple[CalibrationOutcome, Proof | None]:
        """Take the pictures and calibrate; the pictures stay whatever happens.

        Raises:
            ScannerError: it could not be done.
        """
        if self.resumes and self.out is None:
            raise OptionError("--resume needs the folder to go on with.")
        folder = self.out or STORE / "pictures" / f"{datetime.now(UTC):%Y-%m-%dT%H-%M-%SZ}"
        captured = self._captured(folder)
        return self._solved(captured)

    def _captured(self, folder: Path) -> Captured:
        description = bench_description(self.bench)
        plan = CapturePlan(with_camera=self.plan.camera is None, patience_s=self.patience_s)
        with orderly(), Bench.build(description, ask=_wait_for_enter) as machine:
            board = self._board(machine)
            try:
                machine.connect()
            except PositionUnknown:
                machine.zero(0.0)
            with contextlib.closing(_Display(machine)) as display:
                try:
                    return capture(
                        machine, folder, board, display.ask, display.watch, plan, resumes=self.resumes
                    )
                except BaseException:
                    display.close()
                    self._say_what_is_kept(folder)
                    raise

    def _board(self, machine: Bench) -> BoardSpec:
        if self.board:
            return board_from(self.board)
        if machine.description.board is not None:
            return machine.description.board.spec()
        if machine.world is not None:
            return machine.world.stage.board
        raise BenchFileError(
            self.bench or "bench.toml",
            "names no calibration board",
            "Add a [board], see docs/bench-file.md, or say for example --board chessboard:11x8:12.",
        )

    def _say_what_is_kept(self, folder: Path) -> None:
        if CaptureSession.is_begun(folder):
            count = len(Recording.open(folder).entries)
            bench = f" --bench {self.bench}"
            say([f"{count} pictures are kept. Go on with: turnscan calibrate{bench} --resume {folder}"])

    def _solved(self, captured: Captured) -> tuple[CalibrationOutcome, Proof | None]:
        with progress_bar() as show:
            return solve_captured(captured, self.detector, self.plan, show)


def show_proof(proof: Proof) -> None:
    """What it found, as a table, and what to do about it."""
    table = Table(
        title=f"Proof: {proof.points} points of the board at {proof.stops} new angles", title_justify="left"
    )
    for column in ("", "mm", "found"):
        table.add_column(column, overflow="fold", justify="right" if column == "mm" else "left")
    for finding in proof.findings:
        mark, style = _MARKS[finding.verdict]
        table.add_row(mark, f"[{style}]{finding.value_mm:.3f}[/]", finding.words)
    console.print(table)
    say(f"{f.words} {f.advice}" for f in proof.findings if f.verdict is Verdict.FAIR)


class _Display:
    """Shows how the capture goes, and has a person do what only a person can."""

    def __init__(self, machine: Bench) -> None:
        self._hands = None if machine.world is None else simulated_hands(machine.world)
        self._bar: contextlib.AbstractContextManager[ShowProgress] | None = None
        self._show: ShowProgress | None = None
        self._wanted = ""

    def ask(self, request: Request) -> None:
        self.close()
        if self._hands is not None:
            say([f"{request.words} (The simulated hands do it.)"])
            self._hands(request)
        elif request.task is Task.HOLD_BOARD:
            say([request.words])
        else:
            _wait_for_enter(request.words)

    def watch(self, event: CaptureEvent) -> None:
        if event.kind is EventKind.WANTED:
            self._wanted = event.words
            say([f"Please {event.words}."])
        elif event.kind in (EventKind.WAITING, EventKind.GOING_ON):
            say([f"{event.words}."])
        elif event.kind is EventKind.TAKEN and self._hands is None:
            # Whoever holds the board looks at the board.
            console.bell()
        if self._show is None:
            self._bar = progress_bar()
            self._show = self._bar.__enter__()
        self._show(_STAGES[event.stage], round(100.0 * event.done), 100, event.words)

    def close(self) -> None:
        """Take the bar away, so that lines can be written and typed."""
        if self._bar is not None:
            self._bar.__exit__(None, None, None)
        self._bar = self._show = None


def _wait_for_enter(what: str) -> None:
    say([what])
    try:
        console.input("[dim]Press Enter when it is done.[/] ")
    except EOFError as error:
        raise OptionError(
            "Nobody can be asked to press Enter: the input is closed.", "Run the command in a terminal."
        ) from error
