"""Things that a person types in one word: boards, markers, lasers."""

import re
from typing import cast, get_args

from app.errors import OptionError
from app.vision.board import BoardKind, BoardSpec
from app.vision.markers import PlatterSpec
from app.vision.stripe import LaserColour

_SHAPE = re.compile(r"(\d+)[x×](\d+)")


def board_from(text: str) -> BoardSpec:
    """`chessboard:9x6:10`, or `charuco:5x7:40:20:DICT_6X6_250` with the marker's side and dictionary.

    Raises:
        OptionError: it is not of that form.
    """
    parts = text.split(":")
    shape = _SHAPE.fullmatch(parts[1]) if len(parts) >= 3 else None
    wanted = 5 if parts[0] == "charuco" else 3
    if parts[0] not in get_args(BoardKind) or shape is None or len(parts) != wanted:
        raise OptionError(
            f"{text!r} does not describe a board.",
            f"Write KIND:COLUMNSxROWS:MM with one of {', '.join(get_args(BoardKind))}, such as "
            "chessboard:9x6:10; a charuco also needs :MARKER_MM:DICTIONARY, such as "
            "charuco:7x5:20:15:DICT_4X4_50.",
        )
    columns, rows = int(shape[1]), int(shape[2])
    spacing = _length(parts[2], text)
    if not 2 <= columns <= 100 or not 2 <= rows <= 100:
        raise OptionError(f"A board of {columns} x {rows} cannot be used.", "Give 2 to 100 columns and rows.")
    kind = cast(BoardKind, parts[0])
    if kind != "charuco":
        return BoardSpec(kind, columns, rows, spacing)
    marker = _length(parts[3], text)
    if marker >= spacing:
        raise OptionError(f"{text!r}: a marker must be smaller than its square.")
    return BoardSpec(kind, columns, rows, spacing, marker, parts[4])


def platter_from(text: str) -> PlatterSpec:
    """`DICT_4X4_50:30:5,18,27,42`: dictionary, side in mm and numbers of the markers on the table.

    Raises:
        OptionError: it is not of that form.
    """
    parts = text.split(":")
    if len(parts) != 3 or not re.fullmatch(r"\d+(,\d+)*", parts[2]):
        raise OptionError(
            f"{text!r} does not describe markers.",
            "Write DICTIONARY:SIDE_MM:NUMBERS, such as DICT_4X4_50:30:5,18,27,42.",
        )
    return PlatterSpec(parts[0], _length(parts[1], text), tuple(int(n) for n in parts[2].split(",")))


def lasers_from(texts: list[str]) -> dict[str, LaserColour]:
    """`left:red` and so on; the colour may be left out.

    Raises:
        OptionError: a colour is unknown.
    """
    lasers: dict[str, LaserColour] = {}
    for text in texts:
        name, _, colour = text.partition(":")
        if not name or (colour or "any") not in get_args(LaserColour):
            raise OptionError(
                f"{text!r} does not describe a laser.",
                f"Write NAME:COLOUR with one of {', '.join(get_args(LaserColour))}, such as left:red.",
            )
        lasers[name] = cast(LaserColour, colour or "any")
    return lasers


def _length(text: str, whole: str) -> float:
    try:
        length = float(text)
    except ValueError:
        length = float("nan")
    if not 0.0 < length < 1e5:
        raise OptionError(f"{whole!r}: {text!r} is not a length in mm.")
    return length
