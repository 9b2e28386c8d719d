"""`turnscan scan`: pictures from the bench into a recording, points while it goes on."""

import contextlib
import time
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from app.calibration.record import CalibrationRecord
from app.cli.bench import bench_description, calibration_for
from app.cli.console import ShowProgress, check_output, console, progress_bar, say, warn
from app.cli.orderly import orderly
from app.cli.reconstruct import reconstruct_command
from app.devices.bench import Bench
from app.errors import OptionError
from app.jobs.scan_parts import check_lasers, live_points_for, recovery_for
from app.recording.manifest import FrameEntry
from app.scanning.exposure_stack import check_exposures
from app.scanning.live import LivePoints
from app.scanning.plan import LONGEST_EXPOSURE_US, MOST_EXPOSURES, ScanPlan
from app.scanning.run import Recovery, place_table, run_scan
from app.scanning.scan import Taken
from app.scanning.session import ScanSession

_NOT_DONE = 2
_CALIBRATION = "calibration.json"


class _Mode(StrEnum):
    STEP = "step"
    CONTINUOUS = "continuous"


def scan_command(
    out: Annotated[
        Path, typer.Argument(help="Folder of the new recording; with --resume, of an unfinished one.")
    ],
    bench: Annotated[
        str, typer.Option(help="Bench file, or simulated, or simulated:grbl; by default bench.toml.")
    ] = "",
    resume: Annotated[bool, typer.Option("--resume", help="Go on with a scan that ended early.")] = False,
    mode: Annotated[_Mode, typer.Option(help="Stop for every picture, or turn steadily.")] = _Mode.STEP,
    steps: Annotated[int, typer.Option(min=1, help="Stops in one turn.")] = 200,
    laser: Annotated[list[str] | None, typer.Option(help="Lasers that scan; all by default.")] = None,
    turn: Annotated[
        float, typer.Option(min=0.001, max=3600.0, help="How far the table turns, degrees.")
    ] = 360.0,
    seconds_per_turn: Annotated[float, typer.Option(min=0.1, help="Of a continuous scan.")] = 30.0,
    no_dark: Annotated[
        bool, typer.Option("--no-dark", help="No pictures with the lasers off: faster, for a dark room.")
    ] = False,
    texture_every: Annotated[
        int, typer.Option(min=0, help="A picture exposed for texture at every so many stops; 0 for none.")
    ] = 0,
    exposure: Annotated[
        list[float] | None,
        typer.Option(
            min=1.0, max=LONGEST_EXPOSURE_US, help="Microseconds; repeat it for a stack of exposures."
        ),
    ] = None,
    calibration: Annotated[
        Path | None,
        typer.Option("-c", "--calibration", help="Its file; by default the one in use in calibration_store."),
    ] = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="PLY to compute at the end.")] = None,
    patience: Annotated[
        float, typer.Option(min=0.0, help="Seconds to wait for a device that has gone away.")
    ] = 60.0,
    accept_position: Annotated[
        bool,
        typer.Option(
            "--accept-position", help="With --resume: take it that an interrupted move was completed."
        ),
    ] = False,
) -> int:
    """Scan what stands on the table. Ctrl-C keeps what was taken; --resume goes on."""
    if output is not None:
        check_output(output)
    if exposure and len(exposure) > MOST_EXPOSURES:
        raise OptionError(f"A stack has at most {MOST_EXPOSURES} exposures.", "Name fewer.")
    session = ScanSession.resume(out) if resume else None
    description = bench_description(bench or ("" if session is None else session.bench_spec))
    with orderly(), contextlib.ExitStack() as stack:
        try:
            machine = stack.enter_context(Bench.build(description, ask=_ask))
            machine.connect()
            _say_what_is_unknown(machine)
            record = calibration_for(machine, calibration)
            if session is None:
                names = tuple(laser or machine.lasers)
                facts = machine.turntable.facts
                if facts.turns_by_itself:
                    mode, seconds_per_turn = _Mode.CONTINUOUS, 360.0 / facts.slowest_deg_s
                check_lasers(machine, names, record)
                plan = ScanPlan(
                    mode=mode.value, lasers=names, steps=steps, turn_deg=turn, with_dark=not no_dark,
                    texture_every=texture_every, seconds_per_turn=seconds_per_turn,
                    exposures_us=tuple(exposure or ()),
                )  # fmt: skip
                check_exposures(plan, machine.camera)
                session = ScanSession.create(out, plan, machine, bench)
            if record is not None:
                record.save(out / _CALIBRATION)
            recovery = recovery_for(session, record, machine, patience)
            if resume:
                machine.restore(session.table.angle_deg)
                place_table(machine, session, recovery, takes_target=accept_position)
            _scan(machine, session, record, recovery)
        except BaseException as error:
            if session is None or not session.shots:
                raise
            _say_what_is_kept(session, error)
            if isinstance(error, KeyboardInterrupt):
                return _NOT_DONE
            raise
    say([f"{session.shots} pictures in {out}."])
    if output is None:
        if record is not None:
            say([f"Turn them into a cloud: turnscan reconstruct {out} -c {out / _CALIBRATION} -o cloud.ply"])
        return 0
    if record is None:
        raise OptionError(
            "There is no calibration, so there is no cloud.",
            f"Calibrate, then run `turnscan reconstruct {out}`.",
        )
    return reconstruct_command(out, output, out / _CALIBRATION)


class _Progress:
    """Shows how a scan goes."""

    def __init__(self, session: ScanSession, live: LivePoints | None, show: ShowProgress) -> None:
        self.session, self.live, self.show = session, live, show
        self.began_s = time.monotonic()

    def taken(self, taken: Taken, entry: FrameEntry) -> None:
        note = ""
        if self.live is not None:
            self.live.add(taken)
            rate = self.live.points / max(time.monotonic() - self.began_s, 1e-3)
            note = f"{self.live.points:,} points, {rate:,.0f}/s"
        if self.session.plan.mode == "step":
            self.show("Scanning", self.session.shots, self.session.plan.shots, note)
        else:
            # How many pictures there will be depends on the camera; how far the table turns does not.
            turned = self.session.plan.turn_deg * len(self.session.plan.passes)
            self.show("Degrees", round(turned * self.session.done), round(turned), note)

    def waiting(self, problem: str) -> None:
        console.print("[yellow]Paused:[/]", end=" ")
        say([f"{problem}. The scan goes on when it is back; Ctrl-C ends it and keeps what was taken."])

    def going_on(self) -> None:
        say(["It is back; the scan goes on."])


def _ask(what: str) -> None:
    """Have a person do something, and wait for the Enter key."""
    say([what])
    console.input("[dim]Press Enter when it is done.[/] ")


def _scan(bench: Bench, session: ScanSession, record: CalibrationRecord | None, recovery: Recovery) -> None:
    with contextlib.ExitStack() as stack:
        live = live_points_for(session, record, bench)
        if live is not None:
            stack.enter_context(live)
        show = stack.enter_context(progress_bar())
        run_scan(bench, session, _Progress(session, live, show), recovery)
    if live is not None:
        if live.problem:
            warn([f"No live points: {live.problem}"])
        if live.left_out:
            warn([f"{live.left_out} pictures came faster than points could be computed; all are recorded."])


def _say_what_is_unknown(bench: Bench) -> None:
    is_guessed = bench.description.camera.driver in ("uvc", "url", "picamera") and not bench.camera.latency_s
    if is_guessed and not bench.camera.facts.has_timestamps:
        text = (
            "The camera does not tell when it exposed, and the bench file has no latency_ms: a picture may "
            "be one of the stop before. `turnscan doctor` measures it."
        )
        warn([text])


def _say_what_is_kept(session: ScanSession, error: BaseException) -> None:
    if isinstance(error, KeyboardInterrupt):
        console.print("[bold yellow]Stopped.[/]", end=" ")
    say([f"{session.shots} pictures are kept. Go on with: turnscan scan --resume {session.folder}"])
