"""`turnscan library`: the scans that are kept, from the command line."""

import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from app.cli.console import check_output, console, progress_bar, say, warn
from app.errors import OutputError
from app.files import reason, replacing
from app.library.item import ScanItem
from app.library.library import LIBRARY, BinItem, Library
from app.library.limits import in_words
from app.library.zip_stream import ZipStream

library_app = typer.Typer(
    help="The scans that are kept: list, name, throw away, bring back, copy in and out, compute again.",
    no_args_is_help=True,
)
_STREAM = Path("-")
_DOUBTFUL = 1
_STATUS = {"recording": "recording", "cloud": "cloud only", "damaged": "[red]damaged[/]"}

Where = Annotated[Path, typer.Option("--library", help="Folder of the library.")]
Name = Annotated[str, typer.Argument(help="Folder of the scan within the library.")]


@library_app.command("list")
def list_command(
    library: Where = LIBRARY,
    from_bin: Annotated[bool, typer.Option("--bin", help="What was thrown away.")] = False,
) -> None:
    """List the scans, newest first, and the room on the disk."""
    shelf = Library(library)
    if from_bin:
        thrown = shelf.bin()
        if thrown:
            console.print(_bin_table(thrown))
        say([] if thrown else ["The bin is empty."])
    else:
        scans = shelf.scans()
        if scans:
            console.print(_table(scans))
        say([] if scans else [f"There is no scan in {library}."])
    space = shelf.space()
    say([f"{in_words(space.free_bytes)} free, {in_words(space.bin_bytes)} in the bin"])


@library_app.command("show")
def show_command(name: Name, library: Where = LIBRARY) -> None:
    """Say everything that is known of a scan."""
    say(_lines(Library(library).scan(name)))


@library_app.command("rename")
def rename_command(
    name: Name, title: Annotated[str, typer.Argument(help="What to call it.")], library: Where = LIBRARY
) -> None:
    """Give a scan another title; its folder keeps its name."""
    item = Library(library).rename(name, title)
    say([f"{item.name} is called {item.title}."])


@library_app.command("note")
def note_command(
    name: Name,
    text: Annotated[str, typer.Argument(help="Any text; empty for none.")],
    library: Where = LIBRARY,
) -> None:
    """Put a note to a scan, in place of the one it has."""
    item = Library(library).note(name, text)
    say([f"Noted at {item.name}." if item.note else f"{item.name} has no note now."])


@library_app.command("delete")
def delete_command(
    names: Annotated[list[str], typer.Argument(metavar="NAME...", help="Folders within the library.")],
    library: Where = LIBRARY,
) -> None:
    """Put scans into the bin."""
    shelf = Library(library)
    for name in names:
        thrown = shelf.delete(name)
        say([f"{thrown.name} is in the bin. Bring it back with: turnscan library restore {thrown.key}"])


@library_app.command("restore")
def restore_command(
    name: Annotated[str, typer.Argument(help="Its name; or its key, as `list --bin` shows it.")],
    library: Where = LIBRARY,
) -> None:
    """Bring a scan back from the bin."""
    item = Library(library).restore(name)
    say([f"{item.name} is back."])


@library_app.command("empty")
def empty_command(
    library: Where = LIBRARY,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask.")] = False,
) -> None:
    """Erase everything in the bin, for good."""
    shelf = Library(library)
    thrown = shelf.bin()
    if not thrown:
        say(["The bin is empty."])
        return
    scans = f"{len(thrown)} scan" + "s" * (len(thrown) != 1)
    size = in_words(sum(each.scan.size_bytes for each in thrown))
    if not yes:
        typer.confirm(f"Erase {scans}, {size}, for good?", abort=True, err=True)
    # What somebody else threw away meanwhile was not asked about.
    freed = shelf.empty([each.key for each in thrown])
    say([f"{scans} erased, {in_words(freed)}."])


@library_app.command("import")
def import_command(
    source: Annotated[Path, typer.Argument(help="Folder of a scan or a recording, zip file, or PLY.")],
    title: Annotated[str, typer.Option(help="What to call it; by default as it is called.")] = "",
    library: Where = LIBRARY,
) -> None:
    """Copy a scan into the library, after looking through everything in it."""
    # These take a second to load, which a list need not wait for.
    from app.library.take_in import take_in

    with progress_bar() as show:
        item = take_in(
            Library(library), source, title,
            progress=lambda done, total: show("Copying", done >> 20, total >> 20, "MB"),
        )  # fmt: skip
    say(_lines(item))


@library_app.command("export")
def export_command(
    name: Name,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Zip file; by default NAME.zip; - for a stream."),
    ] = None,
    library: Where = LIBRARY,
) -> None:
    """Copy a scan into a zip file, with everything in its folder."""
    stream = Library(library).export(name)
    target = output or Path(f"{name}.zip")
    if target == _STREAM:
        _send(stream)
        return
    check_output(target)
    done = 0
    with progress_bar() as show, replacing(target) as file:
        for data in stream:
            done += file.write(data)
            show("Writing", done >> 20, stream.length >> 20, "MB")
    say([f"{name} is in {target}, {in_words(stream.length)}."])


@library_app.command("reconstruct")
def reconstruct_again_command(
    name: Name,
    calibration: Annotated[
        Path | None, typer.Option("-c", "--calibration", help="Its file; by default the one the scan has.")
    ] = None,
    detector: Annotated[str, typer.Option(help="Stripe detector.")] = "zero-crossing",
    radius: Annotated[float | None, typer.Option(help="Keep points so near to the axis, mm.")] = None,
    above: Annotated[float | None, typer.Option(help="Keep points above this height, mm.")] = None,
    below: Annotated[float | None, typer.Option(help="Keep points below this height, mm.")] = None,
    min_quality: Annotated[
        float, typer.Option(min=0.0, max=1.0, help="Keep points of this quality, 0 to 1.")
    ] = 0.0,
    library: Where = LIBRARY,
) -> int:
    """Compute a scan again; its other clouds stay."""
    # These take seconds to load, which a list need not wait for.
    from app.calibration.record import CalibrationRecord
    from app.cli.reconstruction_lines import reconstruction_lines
    from app.library.again import reconstruct_again
    from app.scanning.reconstruct import ReconstructionOptions

    record = None if calibration is None else CalibrationRecord.load(calibration)
    options = ReconstructionOptions(
        radius_mm=radius, above_mm=above, below_mm=below, min_quality=min_quality
    )  # fmt: skip
    with progress_bar() as show:
        again = reconstruct_again(
            Library(library), name, record, detector, options,
            lambda done, total, points: show("Reconstructing", done, total, f"{points:,} points"),
        )  # fmt: skip
    say(reconstruction_lines(again.report))
    warn(again.report.warnings)
    warn(again.report.doubts, is_doubt=True)
    say([f"Cloud in {library / name / again.cloud.name}."])
    return _DOUBTFUL if again.report.doubts else 0


def _send(stream: ZipStream) -> None:
    try:
        for data in stream:
            sys.stdout.buffer.write(data)
        sys.stdout.buffer.flush()
    except OSError as error:
        raise OutputError("standard output", reason(error)) from error


def _table(scans: tuple[ScanItem, ...]) -> Table:
    table = Table("name", "title", "created", "status", box=None, pad_edge=False)
    for heading in ("pictures", "points", "size"):
        table.add_column(heading, justify="right")
    for item in scans:
        status = _STATUS.get(item.status, item.status)
        table.add_row(
            _plain(item.name), _plain(item.title), _local(item), status, f"{item.pictures:,}",
            f"{item.points:,}", in_words(item.size_bytes),
        )  # fmt: skip
    return table


def _bin_table(thrown: tuple[BinItem, ...]) -> Table:
    table = Table("key", "title", "thrown away", box=None, pad_edge=False)
    table.add_column("size", justify="right")
    for each in thrown:
        when = f"{each.deleted.astimezone():%Y-%m-%d %H:%M}"
        table.add_row(_plain(each.key), _plain(each.scan.title), when, in_words(each.scan.size_bytes))
    return table


def _lines(item: ScanItem) -> list[str]:
    lines = [
        f"Name             {item.name}",
        f"Title            {item.title}",
        f"Created          {_local(item)}",
        f"Status           {item.status}" + (f": {item.reason}" if item.reason else ""),
        f"Pictures         {item.pictures:,}",
        f"Size             {in_words(item.size_bytes)}",
    ]
    if item.calibration is not None:
        error = item.calibration.expected_error_mm
        known = "" if error is None else f", expected error {error:.3f} mm"
        lines.append(f"Calibration      {item.calibration.created.astimezone():%Y-%m-%d %H:%M}{known}")
    for cloud in item.clouds:
        how = f" ({cloud.detector})" if cloud.detector else ""
        lines.append(f"Cloud            {cloud.name}: {cloud.points:,} points{how}")
    lines += [f"Note             {line}" for line in item.note.splitlines()]
    return lines


def _local(item: ScanItem) -> str:
    return f"{item.created.astimezone():%Y-%m-%d %H:%M}"


def _plain(text: str) -> str:
    """Brackets in names are no markup."""
    return text.replace("[", "\\[")
