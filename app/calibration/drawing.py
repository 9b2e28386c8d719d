"""Black shapes on white paper, in millimetres: what a printed board consists of."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias


@dataclass(frozen=True, slots=True)
class Rectangle:
    """A filled rectangle; x and y of its top left corner."""

    x_mm: float
    y_mm: float
    width_mm: float
    height_mm: float


@dataclass(frozen=True, slots=True)
class Disk:
    """A filled circle about (x, y)."""

    x_mm: float
    y_mm: float
    radius_mm: float


@dataclass(frozen=True, slots=True)
class Ring:
    """A thin circle about (x, y): a line to cut along."""

    x_mm: float
    y_mm: float
    radius_mm: float
    line_mm: float


@dataclass(frozen=True, slots=True)
class Text:
    """One line of text; x and y of the left end of its base line."""

    x_mm: float
    y_mm: float
    size_mm: float
    text: str


Shape: TypeAlias = Rectangle | Disk | Ring | Text


@dataclass(frozen=True, slots=True)
class BoardDrawing:
    """A sheet to print, x to the right and y down from its top left corner.

    Attributes:
        title: what it shows.
        width_mm: of everything on it.
        height_mm: the same, down.
        shapes: black on white; none hides another.
        pattern: left, top, width and height of the pattern itself, without ruler and text.
        ruler: x of the ruler's zero and y of its line.
        measure: what a person changes to make the pattern smaller, such as `spacing`.
        measure_mm: how large that is.
    """

    title: str
    width_mm: float
    height_mm: float
    shapes: tuple[Shape, ...]
    pattern: tuple[float, float, float, float]
    ruler: tuple[float, float]
    measure: str
    measure_mm: float


def moved(shapes: Sequence[Shape], x_mm: float, y_mm: float) -> tuple[Shape, ...]:
    """The shapes, further right and down."""
    return tuple(replace(shape, x_mm=shape.x_mm + x_mm, y_mm=shape.y_mm + y_mm) for shape in shapes)
