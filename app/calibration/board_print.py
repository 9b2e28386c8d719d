"""Boards and platter sheets to print: shapes in millimetres, with a ruler to check the printer by."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.calibration.drawing import BoardDrawing, Disk, Rectangle, Ring, Shape, Text, moved
from app.calibration.page import Paper, pdf_bytes, svg_bytes
from app.errors import OptionError
from app.files import write_whole
from app.vision.board import BoardSpec
from app.vision.markers import PlatterSpec, aruco_dictionary

RULER_MM = 100.0
_GAP_MM, _TEXT_MM, _LINE_MM = 7.0, 2.8, 0.2
_RULER_BLOCK_MM = 13.0
"""Height of the ruler's ticks and the two lines of text below it."""
_DOT_SHARE = {"circles": 0.3, "asymmetric_circles": 0.38}
"""Radius of a dot as a share of the spacing."""
_QUIET_SHARE = 0.25
"""White margin a marker needs, as a share of its side."""


def print_board(spec: BoardSpec, path: Path, paper: Paper = "a4") -> None:
    """Write the board to a PDF or SVG file, as the ending of its name says.

    Raises:
        OptionError: there is no such board, it does not fit on the paper, or the ending is neither.
        OutputError: the file cannot be written.
    """
    _print(draw_board(spec), path, paper)


def print_platter(platter: PlatterSpec, diameter_mm: float, path: Path, paper: Paper = "a4") -> None:
    """Write a round sheet of markers for the turntable; see `print_board`."""
    _print(draw_platter(platter, diameter_mm), path, paper)


def _print(drawing: BoardDrawing, path: Path, paper: Paper) -> None:
    if path.suffix.lower() == ".svg":
        write_svg(drawing, path)
    elif path.suffix.lower() == ".pdf":
        write_pdf(drawing, path, paper)
    else:
        raise OptionError(f"{path} is neither a .pdf nor a .svg file.", "Give the file one of these endings.")


def write_pdf(drawing: BoardDrawing, path: Path, paper: Paper = "a4") -> None:
    """One page, upright or lying as the drawing needs it, the drawing in its middle at its true size."""
    write_whole(path, pdf_bytes(drawing, paper))


def write_svg(drawing: BoardDrawing, path: Path) -> None:
    """A picture of exactly the drawing's size, one user unit to the millimetre."""
    write_whole(path, svg_bytes(drawing))


def draw_board(spec: BoardSpec) -> BoardDrawing:
    """The board as it is printed: its frame's x to the right, y down, first corner at the top left."""
    spec.check()
    outline = spec.outline()
    left, top = outline[0, :2]
    width, height = outline[2, :2] - outline[0, :2]
    if spec.kind == "chessboard":
        shapes = _squares(spec.columns + 1, spec.rows + 1, spec.spacing_mm)
    elif spec.kind == "charuco":
        shapes = _squares(spec.columns, spec.rows, spec.spacing_mm) + _charuco_markers(spec)
    else:
        radius = _DOT_SHARE[spec.kind] * spec.spacing_mm
        shapes = [Disk(float(x - left), float(y - top), radius) for x, y, _ in spec.points()]
    counted = (
        "inner corners" if spec.kind == "chessboard" else "squares" if spec.kind == "charuco" else "dots"
    )
    title = f"{spec.description}, counted in {counted}"
    return _with_ruler(title, shapes, (float(width), float(height)), "spacing", spec.spacing_mm)


def draw_platter(platter: PlatterSpec, diameter_mm: float) -> BoardDrawing:
    """A disk to lay on the turntable, the markers evenly along its rim and a cross at its centre.

    Raises:
        OptionError: the markers do not fit on the rim.
    """
    radius, side = diameter_mm / 2.0, platter.marker_mm
    # The outer corners of a marker, with its quiet zone, must stay on the disk whichever way it points.
    out = radius - side * (1.0 + _QUIET_SHARE) * np.sqrt(0.5) - 1.0
    turns = 2.0 * np.pi * np.arange(len(platter.ids)) / max(len(platter.ids), 1)
    room = 2.0 * out * np.sin(np.pi / max(len(platter.ids), 2))
    if not (side > 0.0 and platter.ids and room > side * (1.0 + _QUIET_SHARE) * np.sqrt(2.0)):
        raise OptionError(
            f"{len(platter.ids)} markers of {side:g} mm do not fit on the rim of a {diameter_mm:g} mm disk.",
            "Use fewer or smaller markers, or a larger disk.",
        )
    shapes: list[Shape] = [Ring(radius, radius, radius - _LINE_MM / 2.0, _LINE_MM)]
    for length, line in ((10.0, _LINE_MM), (_LINE_MM, 10.0)):
        shapes.append(Rectangle(radius - length / 2.0, radius - line / 2.0, length, line))
    for number, turn in zip(platter.ids, turns, strict=True):
        x, y = radius + out * np.sin(turn), radius - out * np.cos(turn)
        corner = (float(x - side / 2.0), float(y - side / 2.0))
        shapes += moved(_marker(platter.dictionary, number, side), *corner)
    ids = ", ".join(str(number) for number in platter.ids)
    title = f"platter {diameter_mm:g} mm, {platter.dictionary} {ids}, {side:g} mm"
    return _with_ruler(title, shapes, (diameter_mm, diameter_mm), "diameter", diameter_mm)


def _squares(columns: int, rows: int, side: float) -> list[Shape]:
    return [
        Rectangle(column * side, row * side, side, side)
        for row in range(rows)
        for column in range(columns)
        if (row + column) % 2 == 0
    ]


def _charuco_markers(spec: BoardSpec) -> list[Shape]:
    """Markers in the middle of the white squares, numbered row by row."""
    white = [(r, c) for r in range(spec.rows) for c in range(spec.columns) if (r + c) % 2 == 1]
    inset = (spec.spacing_mm - spec.marker_mm) / 2.0
    shapes: list[Shape] = []
    for number, (row, column) in enumerate(white):
        at = (column * spec.spacing_mm + inset, row * spec.spacing_mm + inset)
        shapes += moved(_marker(spec.dictionary, number, spec.marker_mm), *at)
    return shapes


def _marker(dictionary: str, number: int, side: float) -> list[Shape]:
    """The black cells of a marker from its top left corner, neighbours in a row joined."""
    words = aruco_dictionary(dictionary)
    if not 0 <= number < len(words.bytesList):
        raise OptionError(
            f"{dictionary} has no marker {number}.", "Use a smaller number or a larger dictionary."
        )
    cells = int(words.markerSize) + 2
    bits: NDArray[np.uint8] = np.asarray(words.generateImageMarker(number, cells), np.uint8)
    cell = side / cells
    shapes: list[Shape] = []
    for row, line in enumerate(bits < 128):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], line, [False]]).astype(np.int8)))
        for start, end in edges.reshape(-1, 2):
            shapes.append(Rectangle(float(start) * cell, row * cell, float(end - start) * cell, cell))
    return shapes


def _with_ruler(
    title: str, pattern: list[Shape], size_mm: tuple[float, float], measure: str, measure_mm: float
) -> BoardDrawing:
    """The pattern, centred over a ruler and two lines of text."""
    width, height = size_mm
    # The ruler's first and last tick are as thick as the others and end outside of 0 and 100 mm.
    full_width = max(width, RULER_MM + _LINE_MM)
    left = (full_width - width) / 2.0
    zero, y = (full_width - RULER_MM) / 2.0, height + _GAP_MM
    ruler: list[Shape] = [Rectangle(zero, y - _LINE_MM / 2.0, RULER_MM, _LINE_MM)]
    for tick in range(int(RULER_MM) + 1):
        length = 4.0 if tick % 10 == 0 else 2.8 if tick % 5 == 0 else 1.8
        ruler.append(Rectangle(zero + tick - _LINE_MM / 2.0, y, _LINE_MM, length))
    lines = (f"{RULER_MM:g} mm: measure me. Print at 100 %, no fit-to-page.", title)
    text = [Text(zero, y + 8.0 + 4.0 * number, _TEXT_MM, line) for number, line in enumerate(lines)]
    shapes = (*moved(pattern, left, 0.0), *ruler, *text)
    return BoardDrawing(
        title,
        full_width,
        y + _RULER_BLOCK_MM,
        shapes,
        (left, 0.0, width, height),
        (zero, y),
        measure,
        measure_mm,
    )
