"""`turnscan measure`: sizes, fits and differences of clouds and meshes."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from app.cli.console import check_output, say, warn
from app.errors import OptionError
from app.geometry.arrays import Vector3
from app.geometry.cloud import PointCloud
from app.geometry.mesh import TriangleMesh
from app.surface.measure.deviation_map import deviation_map
from app.surface.measure.distance import span_between
from app.surface.measure.fits import FitKind, fit
from app.surface.measure.picture import deviation_picture
from app.surface.measure.region import parse_region
from app.surface.measure.size import size_of_mesh, size_of_points
from app.surface.measure.thing import MOST_POINTS, Thing, file_points, points_of, read_thing
from app.surface.ply import write_ply
from app.surface.preview import PreviewPainter, write_picture


def measure_command(
    file: Annotated[Path, typer.Argument(help="A cloud (PLY) or a mesh (PLY, STL, OBJ, OFF, GLB, 3MF).")],
    against: Annotated[
        Path | None, typer.Option(help="A cloud or a mesh in the same place, to compare with.")
    ] = None,
    shape: Annotated[FitKind | None, typer.Option("--fit", help="Fit this shape to the points.")] = None,
    region: Annotated[
        str | None,
        typer.Option(
            help="Measure this part alone: box:X1,Y1,Z1,X2,Y2,Z2 or cylinder:RADIUS,BOTTOM,TOP, mm."
        ),
    ] = None,
    start: Annotated[str | None, typer.Option("--from", help="Where a distance begins: X,Y,Z in mm.")] = None,
    end: Annotated[str | None, typer.Option("--to", help="Where it ends: X,Y,Z in mm.")] = None,
    scale: Annotated[
        float | None, typer.Option(min=1e-6, help="Where the colours of --against end, mm.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="PLY of the points, coloured by --against.")
    ] = None,
    picture: Annotated[Path | None, typer.Option(help="PNG of what was measured.")] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Write the numbers as JSON to standard output.")
    ] = False,
) -> int:
    """Measure a cloud or a mesh: its size, a fitted shape, its difference from another."""
    if (start is None) != (end is None):
        raise OptionError("A distance needs both its ends.", "Give --from and --to.")
    if output is not None and (against is None or output.suffix.lower() != ".ply"):
        raise OptionError(
            "--output is for the coloured points of a comparison.",
            "Give --against, and a name that ends in .ply.",
        )
    ends = None if start is None or end is None else (_place(start), _place(end))
    part = None if region is None else parse_region(region)
    for path in (output, picture):
        if path is not None:
            check_output(path, [file] if against is None else [file, against])
    thing = _read(file)
    points = points_of(thing)
    if part is not None:
        points = part.apply(points)
        # What encloses nothing any more has no volume either.
        thing = points
    told: dict[str, Any] = {"file": str(file), "points": len(points)}
    size = size_of_mesh(thing) if isinstance(thing, TriangleMesh) else size_of_points(points.points)
    told["size"] = size.as_json()
    if shape is not None:
        told["fit"] = fit(shape, points.points).as_json()
    if ends is not None:
        told["distance"] = span_between(points.points, *ends).as_json()
    found = None
    if against is not None:
        found = deviation_map(points, _read(against), scale)
        told["deviation"] = found.as_json()
        if output is not None:
            write_ply(output, found.cloud)
    if picture is not None:
        painter = PreviewPainter()
        painter.add(points)
        write_picture(picture, painter.image() if found is None else deviation_picture(found))
    if as_json:
        typer.echo(json.dumps(told, indent=2))
    else:
        say(_lines(told))
    return 0


def _read(path: Path) -> Thing:
    """A file, and a word before it is read where only a part of it will be."""
    count = file_points(path)
    if count > MOST_POINTS:
        warn([f"{path} has {count:,} points: every {-(-count // MOST_POINTS)}th is measured."])
    thing = read_thing(path)
    if isinstance(thing, PointCloud) and not len(thing):
        raise OptionError(f"{path} has no points.", "Name a file with something in it.")
    return thing


def _place(text: str) -> Vector3:
    import numpy as np

    try:
        place = np.array([float(part) for part in text.split(",")])
    except ValueError:
        place = np.zeros(0)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise OptionError(f"{text!r} is no place.", "Write X,Y,Z in mm, such as 10,0,25.5.")
    return place


def _lines(told: dict[str, Any]) -> list[str]:
    """What was measured, in words."""
    size = told["size"]
    lines = [
        f"Points           {told['points']:,}",
        f"Box              {_by(size['extent_mm'])} mm (x, y, z)",
        f"Smallest box     {_by(size['smallest_mm'])} mm, turned by {size['turned_deg']:.1f}°",
    ]
    if size["area_mm2"] is not None:
        lines.append(f"Area             {size['area_mm2']:,.1f} mm²")
        volume = size["volume_mm3"]
        lines.append(f"Volume           {'not closed' if volume is None else f'{volume:,.1f} mm³'}")
    if "fit" in told:
        lines += _fit_lines(told["fit"])
    if "distance" in told:
        lines.append(f"Distance         {told['distance']['distance_mm']:.3f} mm")
    if "deviation" in told:
        found = told["deviation"]
        lines.append(
            f"Deviation        RMS {found['rms_mm']:.3f} mm, 95 % within {found['p95_mm']:.3f} mm, "
            f"largest {found['largest_mm']:.3f} mm"
        )
        side = "positive is outside" if found["signed"] else "inside and outside are not known"
        lines.append(f"                 median {found['median_mm']:+.3f} mm ({side})")
    return lines


def _fit_lines(found: dict[str, Any]) -> list[str]:
    what = f"{found['kind'].capitalize():<17}"
    if found["diameter_mm"] is not None:
        what += f"diameter {found['diameter_mm']:.3f} mm, "
    lines = [f"{what}middle {', '.join(f'{value:.3f}' for value in found['centre_mm'])} mm"]
    if found["direction"] is not None:
        lines.append(
            f"                 direction {', '.join(f'{value:.5f}' for value in found['direction'])}"
        )
    lines.append(
        f"                 residual {found['rms_mm']:.4f} mm RMS of {found['used']:,} points, "
        f"{found['given'] - found['used']:,} left out"
    )
    return lines


def _by(lengths: list[float]) -> str:
    return " x ".join(f"{length:.2f}" for length in lengths)
