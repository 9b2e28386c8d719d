"""Several clouds on the command line: read, laid on each other unless they are already, and told about."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from app.cli.console import warn
from app.errors import OptionError
from app.geometry.cloud import PointCloud
from app.surface.joining.join import Joined, Progress, join
from app.surface.joining.options import JoinOptions, PairedPlaces, Place
from app.surface.ply_reader import ply_points
from app.surface.thinning import MOST_POINTS, read_thinned

_HINT = (
    "Write NUMBER:X,Y,Z=X,Y,Z: the cloud's number from 2 on, a place in it, and the same in the first cloud."
)


def read_clouds(paths: Sequence[Path]) -> list[PointCloud]:
    """All of them, and a word before where too many points are there to use."""
    most = MOST_POINTS // len(paths)
    for path in paths:
        points = ply_points(path)
        if points > most:
            warn([f"{path} has {points:,} points, and {most:,} at most are used: an even choice of them."])
    return [read_thinned(path, most).cloud for path in paths]


def join_clouds(
    clouds: Sequence[PointCloud], paths: Sequence[Path], pairs: Sequence[str], progress: Progress
) -> Joined:
    """One cloud of several, whichever way the thing lay.

    Args:
        clouds: two or more.
        paths: where they came from.
        pairs: as they were typed.
        progress: told how far it is.
    """
    options = JoinOptions(pairs=tuple(_pair(text, len(clouds)) for text in pairs))
    return join(clouds, options, progress, list(map(str, paths)))


def check_pairs(pairs: Sequence[str], count: int) -> None:
    """Complain before the clouds are read.

    Raises:
        OptionError: one of them is no pair of places, or names no cloud.
    """
    for text in pairs:
        _pair(text, count)


def in_one_frame(clouds: Sequence[PointCloud]) -> list[PointCloud]:
    """Clouds that lie as they should; they keep their lasers' names where all have the same."""
    if all(cloud.laser_names == clouds[0].laser_names for cloud in clouds):
        return list(clouds)
    return [replace(cloud, laser=np.zeros_like(cloud.laser), laser_names=()) for cloud in clouds]


def joined_lines(paths: Sequence[Path], joined: Joined) -> list[str]:
    """How well the clouds fit."""
    lines = [f"Joined           {len(paths)} clouds, residual {joined.residual_mm:.3f} mm"]
    lines += [
        f"                 {path}: {100.0 * placed.overlap:.0f} % of it lies on the others, residual "
        f"{placed.residual_mm:.3f} mm{'' if placed.is_sure else ', not sure'}"
        for path, placed in zip(paths, joined.placements, strict=True)
    ]
    return lines


def _pair(text: str, count: int) -> PairedPlaces:
    number, colon, places = text.partition(":")
    here, equals, there = places.partition("=")
    if not (colon and equals and number.isdecimal()):
        raise OptionError(f"--pair {text!r} is no pair of places.", _HINT)
    if not 2 <= int(number) <= count:
        raise OptionError(f"--pair {text!r}: there are {count} clouds, and the first one stays.", _HINT)
    return PairedPlaces(cloud=int(number) - 1, here=_place(here, text), there=_place(there, text))


def _place(text: str, whole: str) -> Place:
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise OptionError(f"--pair {whole!r}: {text!r} is no place.", _HINT) from None
    if not np.isfinite([x, y, z]).all():
        raise OptionError(f"--pair {whole!r}: {text!r} is no place.", _HINT)
    return (x, y, z)
