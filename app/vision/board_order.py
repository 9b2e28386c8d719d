"""Which corner of a board is the first: the same one in every picture, as far as the pattern tells."""

import cv2
import numpy as np

from app.geometry.arrays import Floats
from app.vision.stripe import Image


def chessboard_order(grey: Image, grid: Floats) -> Floats:
    """The grid (rows, columns, 2) turned so that it is numbered as printed.

    Not mirrored; the first corner is the one at the black corner square where colours can tell; among what
    is left, rows run to the right or down.
    """
    options = _turned(_unmirrored(grid))
    black_first = [option for option in options if _starts_black(grey, option)]
    return most_upright(black_first or options)


def most_upright(options: list[Floats]) -> Floats:
    """The option whose rows run most to the right and down; of four options, most to the right.

    The border between two numberings is a diagonal, so that neither a board that stands nor one that lies on
    its side is near it.
    """
    towards = np.array([1.0, 1.0 if len(options) <= 2 else 0.0])
    return max(options, key=lambda grid: float((grid[:, -1] - grid[:, 0]).mean(axis=0) @ towards))


def _turned(grid: Floats) -> list[Floats]:
    """All numberings by rotation that keep rows and columns in number."""
    options = [grid, grid[::-1, ::-1]]
    if grid.shape[0] == grid.shape[1]:
        quarter = np.rot90(grid)
        options += [quarter, quarter[::-1, ::-1]]
    return options


def _unmirrored(grid: Floats) -> Floats:
    across = (grid[:, -1] - grid[:, 0]).mean(axis=0)
    down = (grid[-1] - grid[0]).mean(axis=0)
    return grid if across[0] * down[1] - across[1] * down[0] > 0.0 else grid[::-1]


def _starts_black(grey: Image, grid: Floats) -> bool:
    """Whether the squares at even places are darker than their neighbours."""
    centres = (grid[:-1, :-1] + grid[:-1, 1:] + grid[1:, :-1] + grid[1:, 1:]) / 4.0
    values = _sampled(grey, centres)
    place = np.add.outer(np.arange(values.shape[0]), np.arange(values.shape[1]))
    sign = np.where(place % 2 == 0, 1.0, -1.0)
    return float(np.median(sign[:, :-1] * np.diff(values, axis=1))) > 0.0


def _sampled(grey: Image, places: Floats) -> Floats:
    smooth = cv2.blur(grey, (3, 3))
    height, width = grey.shape
    u = np.clip(np.rint(places[..., 0]), 0, width - 1).astype(np.intp)
    v = np.clip(np.rint(places[..., 1]), 0, height - 1).astype(np.intp)
    values: Floats = np.asarray(smooth)[v, u].astype(np.float64)
    return values
