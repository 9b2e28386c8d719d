"""`turnscan doctor`: what the bench really does, measured, and what to do about it."""

import contextlib
import json
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from app.checkup.checkup import Check, checkup, chosen
from app.checkup.examination import Examination
from app.checkup.finding import Finding, Report, State
from app.cli.bench import bench_description, calibration_for
from app.cli.console import ShowProgress, check_output, console, progress_bar, say
from app.cli.orderly import orderly
from app.devices.bench import Bench
from app.devices.bench_file import BenchDescription
from app.errors import DeviceError
from app.files import write_whole
from app.recording.manifest_facts import PlatterFacts

_IN_ORDER, _NEEDS_ATTENTION = 0, 1
_MARKS = {
    State.OK: ("[green]ok[/]", "green"),
    State.ATTENTION: ("[yellow]look[/]", "yellow"),
    State.BAD: ("[bold red]bad[/]", "red"),
    State.SKIPPED: ("[dim]-[/]", "dim"),
}
_PLATTER = PlatterFacts(kind="aruco", dictionary="DICT_4X4_50", marker_mm=14.0, ids=tuple(range(8)))


def doctor_command(
    bench: Annotated[
        str, typer.Option(help="Bench file, or simulated, or simulated:grbl; by default bench.toml.")
    ] = "",
    only: Annotated[
        list[str] | None,
        typer.Option(
            help="Check only this: board, camera, machine, lasers, picture or turntable. Repeatable."
        ),
    ] = None,
    folder: Annotated[Path, typer.Option(help="Where scans would go.")] = Path(),
    calibration: Annotated[
        Path | None,
        typer.Option("-c", "--calibration", help="Its file; by default the one in use in calibration_store."),
    ] = None,
    out: Annotated[Path | None, typer.Option("--json", help="Write the report to this file, too.")] = None,
) -> int:
    """Measure what the bench really does, and say what to do. The table turns and the lasers light."""
    if out is not None:
        check_output(out)
    checks = chosen([name for names in only or [] for name in names.split(",")])
    description = _equipped(bench_description(bench))
    with orderly(), Bench.build(description) as machine:
        troubles = _connected(machine)
        record = calibration_for(machine, calibration)
        report = _examined(Examination(machine, folder, record), checks)
    report = Report(report.bench, (*troubles, *report.findings), report.created)
    if out is not None:
        text = json.dumps(report.as_json(), indent=1, ensure_ascii=False, allow_nan=False)
        write_whole(out, text.encode() + b"\n")
    _show(report)
    return _NEEDS_ATTENTION if report.troubles else _IN_ORDER


def _equipped(description: BenchDescription) -> BenchDescription:
    """A simulated bench that names nothing to watch its table by gets markers on it."""
    if description.is_simulated and description.platter is None and description.board is None:
        return description.model_copy(update={"platter": _PLATTER})
    return description


def _connected(machine: Bench) -> tuple[Finding, ...]:
    """Connect what can be; what cannot is a finding, as long as something is left to look at.

    Raises:
        DeviceError: neither device is there.
    """
    errors: list[tuple[str, DeviceError]] = []
    for name, connect in (("board", machine.connect_turntable), ("camera", machine.connect_camera)):
        try:
            connect()
        except DeviceError as error:
            errors.append((name, error))
    if not machine.turntable.is_connected and not machine.camera.state.is_connected:
        raise errors[0][1]
    return tuple(
        Finding(f"{name}.connection", State.BAD, f"{error.message}.", error.hint) for name, error in errors
    )


def _examined(exam: Examination, checks: tuple[Check, ...]) -> Report:
    with contextlib.ExitStack() as stack:
        show = stack.enter_context(progress_bar())
        return checkup(exam, checks, _Shown(exam, show))


class _Shown:
    """One bar for the whole checkup; beside it what is being done."""

    def __init__(self, exam: Examination, show: ShowProgress) -> None:
        self.show, self.done, self.total, self.words = show, 0, 1, ""
        exam.tell = self.note

    def __call__(self, words: str, done: int, total: int) -> None:
        self.words, self.done, self.total = words, done, total
        self.show("Checkup", done, total, words)

    def note(self, note: str) -> None:
        self.show("Checkup", self.done, self.total, f"{self.words}: {note}")


def _show(report: Report) -> None:
    table = Table(title=f"Checkup of {report.bench}", title_justify="left", show_lines=False)
    table.add_column("")
    table.add_column("Check", no_wrap=True)
    table.add_column("Found", overflow="fold")
    for finding in report.findings:
        mark, style = _MARKS[finding.state]
        table.add_row(mark, f"[{style}]{_plain(finding.check)}[/]", _plain(finding.sentence))
    console.print(table)
    for number, finding in enumerate(report.troubles, start=1):
        console.print(f"[bold]{number}.[/] {_plain(finding.sentence)}", soft_wrap=True)
        console.print(f"   [bold]{_plain(finding.advice)}[/]", soft_wrap=True)
    for finding in report.findings:
        if finding.state is State.SKIPPED and finding.advice:
            say([f"Not measured ({finding.check}): {finding.advice}"])
    if not report.troubles:
        say(["All that was measured is in order."])


def _plain(text: str) -> str:
    """Brackets in names are no markup."""
    return text.replace("[", "\\[")
