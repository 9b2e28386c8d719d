"""`turnscan calibrations`: those that are kept; which one is used; in and out, also of other programs."""

import json
import math
import sys
from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.table import Table

from app.calibration.camera_file import OPENCV_SUFFIXES
from app.calibration.compare import compare
from app.calibration.foreign.importing import import_calibration, notes_of
from app.calibration.foreign.opencv import as_opencv
from app.calibration.record import CalibrationRecord
from app.calibration.store import STORE, CalibrationStore, KeptCalibration
from app.cli.bench import BENCH_FILE, bench_description
from app.cli.calibration_lines import comparison_lines, kept_as_json, missing_for_a_scan, record_lines
from app.cli.console import check_output, console, say, warn
from app.devices.frame import Mounting, Rotation
from app.errors import OptionError
from app.files import write_whole

calibrations_app = typer.Typer(
    help="Calibrations that are kept: list, compare, choose, and exchange them with other programs.",
    no_args_is_help=True,
)
_JSON_ENDING = ".json"
_TURNS: dict[str, Rotation] = {"0": 0, "90": 90, "180": 180, "270": 270}

_Name = Annotated[str, typer.Argument(help="Its name or the beginning of it, `current`, or a file.")]
_KeptName = Annotated[str, typer.Argument(help="Its name or the beginning of it, or `current`.")]
_AsJson = Annotated[bool, typer.Option("--json", help="For programs: JSON on standard output.")]


@calibrations_app.command("list")
def list_command(
    as_json: _AsJson = False,
    removed: Annotated[bool, typer.Option("--removed", help="Those in the bin instead.")] = False,
) -> None:
    """Show what is kept, oldest first; the one in use is marked."""
    store = CalibrationStore(STORE)
    all_kept = store.kept(in_bin=removed)
    if as_json:
        _print_json([kept_as_json(kept) for kept in all_kept])
        return
    if not all_kept:
        say([f"{store.folder} holds no calibration{' in its bin' if removed else ' yet'}."])
        return
    console.print(_table(all_kept))
    if not removed:
        in_bin = len(store.removed())
        say([f"{in_bin} in the bin: `turnscan calibrations list --removed`."] if in_bin else [])
        # Says so where the choice is broken.
        store.current_path()


@calibrations_app.command("show")
def show_command(name: _Name = "current", as_json: _AsJson = False) -> None:
    """Tell what a calibration holds, where it comes from and what it does not know."""
    record, label = _record(name)
    if as_json:
        sys.stdout.write(record.to_bytes().decode())
        return
    say([f"Calibration      {label}", *record_lines(record)])
    warn(notes_of(record))


@calibrations_app.command("compare")
def compare_command(first: _Name, second: _Name = "current", as_json: _AsJson = False) -> None:
    """Tell what the second has changed against the first, and what it means at the object."""
    (old, old_label), (new, new_label) = _record(first), _record(second)
    change = compare(old, new)
    if as_json:
        _print_json({"first": old_label, "second": new_label, **change.as_json()})
        return
    say([f"From {old_label} to {new_label}:"])
    say(comparison_lines(change, [old.expected_error_mm, new.expected_error_mm]))


@calibrations_app.command("use")
def use_command(name: _KeptName) -> None:
    """Use this one from now on; a removed one comes back."""
    store = CalibrationStore(STORE)
    path = store.use(name)
    say([f"In use: {path.stem}."])
    _warn_if_incomplete(CalibrationRecord.load(path))


@calibrations_app.command("import")
def import_command(
    file: Annotated[
        Path,
        typer.Argument(help="Of this program, of Horus, FabScanPi's config.json, or a camera of OpenCV."),
    ],
    rotation: Annotated[
        Literal["0", "90", "180", "270"] | None,
        typer.Option(help="How the bench turns pictures, degrees clockwise; by default as bench.toml says."),
    ] = None,
    mirror: Annotated[
        bool | None,
        typer.Option(
            "--mirror/--no-mirror", help="Whether it mirrors them then; by default as bench.toml says."
        ),
    ] = None,
    use: Annotated[bool, typer.Option("--use", help="Use it from now on.")] = False,
) -> None:
    """Keep a calibration that was made elsewhere, also by another program."""
    store = CalibrationStore(STORE)
    record = import_calibration(file, _mounting(rotation, mirror))
    already = next((kept for kept in store.kept() if _is_same(kept, record)), None)
    path = already.path if already is not None else store.save(record, is_current=False)
    if use:
        store.use(path.stem)
    say([f"{'Was there already' if already is not None else 'Kept'} as {path.stem}.", *record_lines(record)])
    warn(notes_of(record))
    _warn_if_incomplete(record)
    if store.current_path() == path:
        say([f"In use: {path.stem}."])
    else:
        say([f"Not in use. To change that: turnscan calibrations use {path.stem}"])


@calibrations_app.command("export")
def export_command(
    output: Annotated[
        Path, typer.Option("-o", "--output", help=".json as it is, or .yml, .yaml, .xml for OpenCV.")
    ],
    name: _Name = "current",
) -> None:
    """Write a calibration for this program elsewhere (.json) or for OpenCV's (.yml, .yaml, .xml)."""
    check_output(output)
    record, label = _record(name)
    ending = output.suffix.lower()
    if ending not in {_JSON_ENDING, *OPENCV_SUFFIXES}:
        raise OptionError(f"{output}: a calibration is written as .json, .yml, .yaml or .xml.")
    data = record.to_bytes() if ending == _JSON_ENDING else as_opencv(record, ending)
    write_whole(output, data)
    say([f"{label} in {output}."])


@calibrations_app.command("remove")
def remove_command(name: _KeptName) -> None:
    """Put a calibration into the bin; `use` takes it back."""
    store = CalibrationStore(STORE)
    removed = store.find(name).stem
    path = store.remove(name)
    say([f"Removed: {removed}, now {path}."])
    if store.paths():
        say([f"In use: {store.current_path().stem}."])
    else:
        say(["No calibration is left."])


def _record(name: str) -> tuple[CalibrationRecord, str]:
    """A calibration of the store, or of a file; and what to call it."""
    if Path(name).is_file():
        return import_calibration(Path(name), _mounting(None, None)), name
    path = CalibrationStore(STORE).find(name)
    return CalibrationRecord.load(path), path.stem


def _mounting(rotation: str | None, mirror: bool | None) -> Mounting:
    """How the bench turns pictures: as asked, else as the bench file here says, else not at all."""
    here = Mounting()
    if BENCH_FILE.is_file() and (rotation is None or mirror is None):
        camera = bench_description("").camera
        here = Mounting(camera.rotation, camera.mirror)
    return Mounting(
        here.rotation if rotation is None else _TURNS[rotation],
        here.is_mirrored if mirror is None else mirror,
    )


def _is_same(kept: KeptCalibration, record: CalibrationRecord) -> bool:
    return kept.record is not None and kept.record.to_bytes() == record.to_bytes()


def _warn_if_incomplete(record: CalibrationRecord) -> None:
    missing = missing_for_a_scan(record)
    if missing:
        warn([f"Not enough for a scan: it has no {missing}."])


def _table(all_kept: tuple[KeptCalibration, ...]) -> Table:
    table = Table()
    table.add_column("")
    table.add_column("Name", no_wrap=True)
    for heading in ("Method", "Pictures", "Lasers", "Expected error"):
        table.add_column(heading, overflow="fold")
    for kept in all_kept:
        mark = "[green]in use[/]" if kept.is_current else ""
        if kept.record is None:
            table.add_row(mark, _plain(kept.name), f"[red]cannot be read: {_plain(kept.problem)}[/]")
            continue
        record = kept.record
        width, height = record.camera.size
        expected = record.expected_error_mm
        table.add_row(
            mark,
            _plain(kept.name),
            _plain(record.method or "unknown"),
            f"{width} x {height}",
            _plain(", ".join(record.lasers) or "none"),
            f"{expected:.3f} mm" if math.isfinite(expected) else "unknown",
        )
    return table


def _print_json(document: object) -> None:
    typer.echo(json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False))


def _plain(text: str) -> str:
    """Brackets in names are no markup."""
    return text.replace("[", "\\[")
