"""`turnscan surface`: clouds in, a thing out that can be printed, kept or measured."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from app.cli.console import progress_bar, say, warn
from app.cli.surface_files import SurfaceFiles
from app.cli.surface_join import check_pairs, in_one_frame, join_clouds, joined_lines, read_clouds
from app.cli.surface_lines import finish_lines
from app.errors import OptionError
from app.surface.exports.units import Unit
from app.surface.exports.write import CLOUD_SUFFIXES, MESH_SUFFIXES
from app.surface.finish import Finish, Preset, finish, preset_mesh
from app.surface.joining.join import Joined
from app.surface.meshing.options import MeshOptions
from app.surface.step import STEPS, StepDocument, parse_step

_DOUBTFUL = 1
_PARTS = 1000


def surface_command(
    clouds: Annotated[
        list[Path],
        typer.Argument(help="PLY files with points, of this program or another; several are joined first."),
    ],
    output: Annotated[
        list[Path],
        typer.Option("-o", "--output", help=f"The mesh: {', '.join(MESH_SUFFIXES)}. May be given again."),
    ],
    preset: Annotated[Preset, typer.Option(help="What the thing is wanted for.")] = Preset.PRINT,
    detail: Annotated[
        float | None, typer.Option(help="Size of the finest detail, mm; by default as fine as the points.")
    ] = None,
    triangles: Annotated[int | None, typer.Option(min=4, help="Most triangles.")] = None,
    tolerance: Annotated[
        float | None, typer.Option(help="Leave out triangles within this distance, mm; 0 for none.")
    ] = None,
    is_open: Annotated[bool, typer.Option("--open", help="End the surface where the points end.")] = False,
    base: Annotated[
        bool | None,
        typer.Option(
            "--base/--no-base",
            help="Close it below with a flat base, or roundly; by default roundly where clouds are joined.",
        ),
    ] = None,
    holes: Annotated[
        float | None, typer.Option(min=0.0, help="Close holes of an open mesh up to this width, mm.")
    ] = None,
    step: Annotated[
        list[str] | None,
        typer.Option(help="A step instead of the preset's: its kind, or kind:name=value,name=value."),
    ] = None,
    no_steps: Annotated[bool, typer.Option("--no-steps", help="Take the points as they are.")] = False,
    unit: Annotated[
        Unit, typer.Option(help="Of the numbers in the file; GLB is always in metres.")
    ] = Unit.MM,
    texture: Annotated[
        int | None,
        typer.Option(
            min=64, max=8192, help="Colours of OBJ and GLB as a picture of at most so many pixels a side."
        ),
    ] = None,
    clean: Annotated[
        Path | None, typer.Option(help=f"Write the cleaned cloud, too: {', '.join(CLOUD_SUFFIXES)}.")
    ] = None,
    joined: Annotated[
        Path | None,
        typer.Option(help=f"Write what several clouds were joined to, too: {', '.join(CLOUD_SUFFIXES)}."),
    ] = None,
    pair: Annotated[
        list[str] | None,
        typer.Option(
            help="A place in the second cloud and the same in the first: 2:X,Y,Z=X,Y,Z. Three or more of a "
            "cloud say how it lies."
        ),
    ] = None,
    no_join: Annotated[
        bool, typer.Option("--no-join", help="Several clouds lie in one frame already.")
    ] = False,
) -> int:
    """Turn a point cloud, or several of one thing, into a mesh."""
    files = SurfaceFiles(output, clean, joined, unit, texture)
    files.check(clouds)
    is_joined = len(clouds) > 1 and not no_join
    if (joined is not None or pair) and not is_joined:
        raise OptionError(
            "--joined and --pair are for several clouds that are joined.",
            "Name two clouds, without --no-join.",
        )
    check_pairs(pair or [], len(clouds))
    if len({path.resolve() for path in clouds}) < len(clouds):
        raise OptionError("A cloud is named twice.", "Name different clouds of one thing.")
    if step and no_steps:
        raise OptionError("--step and --no-steps contradict each other.")
    changed: dict[str, Any] = {}
    if is_open:
        changed["is_closed"] = False
    # What was turned over was seen from below, too.
    if base is not None or is_joined:
        changed["has_flat_base"] = bool(base)
    if tolerance is not None:
        changed["tolerance_mm"] = tolerance or None
    given = {"cell_mm": detail, "triangles": triangles, "hole_mm": holes}
    changed |= {name: value for name, value in given.items() if value is not None}
    order = Finish(
        preset=preset,
        mesh=_mesh_options(preset, changed),
        steps=() if no_steps else tuple(map(_step, step)) if step else None,
        texture_px=texture,
    )
    whole: Joined | None = None
    with progress_bar() as show:
        read = read_clouds(clouds)
        if is_joined:
            whole = join_clouds(
                read,
                clouds,
                pair or [],
                lambda words, share: show("Joining", round(_PARTS * share), _PARTS, words),
            )
        done = finish(
            in_one_frame(read) if whole is None else [whole.cloud],
            order,
            lambda words, share: show("Making the surface", round(_PARTS * share), _PARTS, words),
        )
        mesh = done.mesh
        assert mesh is not None
    if whole is not None:
        say(joined_lines(clouds, whole))
        warn(whole.notes)
        warn(whole.doubts, is_doubt=True)
    files.write(mesh, done.texture, done.cloud, None if whole is None else whole.cloud)
    report = done.report
    say(finish_lines(report, mesh))
    warn(report.notes)
    warn(report.doubts, is_doubt=True)
    printing = report.printing
    if printing is not None:
        bad = [f"{finding.sentence} {finding.advice}" for finding in printing.findings if finding.advice]
        warn(bad, is_doubt=not printing.is_printable)
    say([f"Written          {', '.join(map(str, files.all()))}"])
    doubts = (*report.doubts, *(() if whole is None else whole.doubts))
    return _DOUBTFUL if doubts or (printing is not None and not printing.is_printable) else 0


def _mesh_options(preset: Preset, changed: dict[str, Any]) -> MeshOptions:
    try:
        return MeshOptions.model_validate(preset_mesh(preset).model_dump() | changed)
    except ValueError as error:
        names = {"cell_mm": "--detail", "tolerance_mm": "--tolerance", "hole_mm": "--holes"}
        place = next(name for name in changed if name in str(error))
        raise OptionError(f"{names.get(place, place)} cannot be {changed[place]}.") from None


def _step(text: str) -> StepDocument:
    """`radius-outliers` or `quality:least=0.5,most_sigma_mm=0.2`."""
    kind, _, settings = text.partition(":")
    document: StepDocument = {"kind": kind}
    for part in filter(None, settings.split(",")):
        name, equals, value = part.partition("=")
        if not equals:
            raise OptionError(
                f"--step {text!r}: {part!r} is no setting.", "Write kind:name=value,name=value."
            )
        document[name] = _value(value)
    if kind not in STEPS:
        raise OptionError(f"There is no step called {kind[:60]!r}.", f"There are: {', '.join(STEPS)}.")
    parse_step(document)
    return document


def _value(text: str) -> object:
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        return text
