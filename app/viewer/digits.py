"""Numbers as strokes, as a calculator writes them: lines stay crisp however near one looks."""

import numpy as np
from numpy.typing import NDArray

# Ends of the seven strokes of a digit one wide and two high, seen with y upwards.
_STROKES = np.array(
    [
        [[0, 2], [1, 2]], [[1, 2], [1, 1]], [[1, 1], [1, 0]], [[1, 0], [0, 0]],
        [[0, 0], [0, 1]], [[0, 1], [0, 2]], [[0, 1], [1, 1]],
    ],
    np.float64,
)  # fmt: skip
_DIGITS = ("012345", "12", "01346", "01236", "1256", "02356", "023456", "012", "0123456", "012356")
_ADVANCE = 1.6


_POINT = np.array([[[0.4, 0.0], [0.6, 0.0]]])


def strokes(number: int | str) -> NDArray[np.float64]:
    """(N, 2, 2) lines of a number, its digits two high, its middle at the origin; `12.50` as text."""
    text = str(number)
    width = _ADVANCE * (len(text) - 1) + 1.0
    lines = [
        (_POINT if digit == "." else _STROKES[[int(stroke) for stroke in _DIGITS[int(digit)]]])
        + [place * _ADVANCE - width / 2.0, -1.0]
        for place, digit in enumerate(text)
    ]  # fmt: skip
    return np.concatenate(lines)
