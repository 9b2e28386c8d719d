"""A drawing as the bytes of a PDF page or an SVG picture, at its true size."""

import io
import math
from typing import Literal, TypeAlias
from xml.sax.saxutils import escape

from app.calibration.drawing import BoardDrawing, Disk, Rectangle, Ring, Text
from app.errors import OptionError

Paper: TypeAlias = Literal["a4", "letter"]

PAPERS_MM: dict[str, tuple[float, float]] = {"a4": (210.0, 297.0), "letter": (215.9, 279.4)}
"""Width and height of the upright sheet."""
_PAPER_NAMES = {"a4": "A4", "letter": "Letter"}
MARGIN_MM = 5.0
"""What most printers leave white at the edge."""
_POINTS_PER_MM = 72.0 / 25.4


def page_size(drawing: BoardDrawing, paper: Paper) -> tuple[float, float]:
    """Width and height in mm of the sheet that holds the drawing; upright where both ways fit.

    Raises:
        OptionError: neither way fits; the hint names how much smaller the pattern has to be.
    """
    if paper not in PAPERS_MM:
        raise OptionError(f"There is no paper called {paper!r}.", f"Choose one of: {', '.join(PAPERS_MM)}.")
    upright = PAPERS_MM[paper]
    for width, height in (upright, upright[::-1]):
        if _shrink_to_fit(drawing, width, height) >= 1.0:
            return width, height
    share = max(_shrink_to_fit(drawing, *size) for size in (upright, upright[::-1]))
    raise OptionError(
        f"This does not fit on {_PAPER_NAMES[paper]} paper: {drawing.title}.", _largest_hint(drawing, share)
    )


def pdf_bytes(drawing: BoardDrawing, paper: Paper) -> bytes:
    """One page with the drawing in its middle."""
    # Loaded when it is wanted, since few starts of the server see a page printed.
    from reportlab.pdfgen.canvas import Canvas

    width, height = page_size(drawing, paper)
    left, top = (width - drawing.width_mm) / 2.0, (height - drawing.height_mm) / 2.0
    file = io.BytesIO()
    canvas = Canvas(file, pagesize=(width * _POINTS_PER_MM, height * _POINTS_PER_MM), invariant=1)
    canvas.setTitle(drawing.title)
    canvas.setCreator("turnscan")
    # A viewer that honours it offers no scaling in its print dialogue.
    canvas.setViewerPreference("PrintScaling", "None")
    canvas.translate(left * _POINTS_PER_MM, (height - top) * _POINTS_PER_MM)
    canvas.setFillGray(0.0)
    canvas.setStrokeGray(0.0)
    # One path for all rectangles: those that touch are then filled without a seam.
    path = canvas.beginPath()
    for shape in drawing.shapes:
        x, y = shape.x_mm * _POINTS_PER_MM, -shape.y_mm * _POINTS_PER_MM
        if isinstance(shape, Rectangle):
            size = shape.width_mm * _POINTS_PER_MM, shape.height_mm * _POINTS_PER_MM
            path.rect(x, y - size[1], *size)
        elif isinstance(shape, Disk):
            canvas.circle(x, y, shape.radius_mm * _POINTS_PER_MM, stroke=0, fill=1)
        elif isinstance(shape, Ring):
            canvas.setLineWidth(shape.line_mm * _POINTS_PER_MM)
            canvas.circle(x, y, shape.radius_mm * _POINTS_PER_MM, stroke=1, fill=0)
        else:
            canvas.setFont("Helvetica", shape.size_mm * _POINTS_PER_MM)
            canvas.drawString(x, y, shape.text)
    canvas.drawPath(path, stroke=0, fill=1)
    canvas.showPage()
    canvas.save()
    return file.getvalue()


def svg_bytes(drawing: BoardDrawing) -> bytes:
    """A picture a margin larger than the drawing, one user unit to the millimetre."""
    width, height = (_number(side + 2.0 * MARGIN_MM) for side in (drawing.width_mm, drawing.height_mm))
    edge = _number(-MARGIN_MM)
    rectangles, others = [], []
    for shape in drawing.shapes:
        x, y = _number(shape.x_mm), _number(shape.y_mm)
        match shape:
            case Rectangle():
                across, down = _number(shape.width_mm), _number(shape.height_mm)
                rectangles.append(f"M{x} {y}h{across}v{down}h-{across}z")
            case Disk():
                others.append(f'<circle cx="{x}" cy="{y}" r="{_number(shape.radius_mm)}"/>')
            case Ring():
                others.append(
                    f'<circle cx="{x}" cy="{y}" r="{_number(shape.radius_mm)}" fill="none" '
                    f'stroke="black" stroke-width="{_number(shape.line_mm)}"/>'
                )
            case Text():
                others.append(
                    f'<text x="{x}" y="{y}" font-family="Helvetica, Arial, sans-serif" '
                    f'font-size="{_number(shape.size_mm)}">{escape(shape.text)}</text>'
                )
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        (
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}mm" height="{height}mm" '
            f'viewBox="{edge} {edge} {width} {height}">'
        ),
        f"<title>{escape(drawing.title)}</title>",
        (f'<rect x="{edge}" y="{edge}" width="{width}" height="{height}" fill="white"/>'),
        f'<path d="{"".join(rectangles)}"/>',
        *others,
        "</svg>",
        "",
    ]
    return "\n".join(lines).encode()


def _number(value: float) -> str:
    """Shortest form to a hundredth of a micrometre."""
    text = f"{value:.5f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def _shrink_to_fit(drawing: BoardDrawing, width: float, height: float) -> float:
    """How large the pattern may be on that sheet, as a share of its size; ruler and text keep theirs."""
    _, _, across, down = drawing.pattern
    room = width - 2.0 * MARGIN_MM, height - 2.0 * MARGIN_MM - (drawing.height_mm - down)
    return min(room[0] / across, room[1] / down) + 1e-9


def _largest_hint(drawing: BoardDrawing, share: float) -> str:
    largest = math.floor(10.0 * share * drawing.measure_mm) / 10.0
    if largest <= 0.0:
        return "Use fewer columns and rows."
    return (
        f"The largest {drawing.measure} that fits is {largest:g} mm; or use fewer columns and rows, or SVG."
    )
