"""Colour for a cloud that is there: pictures with the lasers off, from all around."""

from collections.abc import Callable, Generator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from app.devices.bench import Bench
from app.geometry.arrays import Floats
from app.geometry.cloud import PointCloud
from app.geometry.rig import Rig
from app.recording.manifest import FrameEntry
from app.recording.reader import Recording
from app.recording.shot import Role
from app.scanning.colour import colours_at_angle
from app.scanning.frames import exposed_for_colour
from app.scanning.plan import ScanPlan
from app.scanning.scan import Taken, scan_steps


def take_textures(
    bench: Bench, pictures: int, before_move: Callable[[float], None]
) -> Generator[Taken, None, None]:
    """One turn in stops, a picture with the camera's settings for texture at each. Raises as `scan_steps`."""
    # Of a scan that takes such a picture at every stop, nothing but these.
    plan = ScanPlan(lasers=("none",), steps=pictures, with_dark=False, texture_every=1)
    return scan_steps(bench, plan, lambda stop, look: not look.for_colour, before_move)


def texture_entries(recording: Recording) -> tuple[FrameEntry, ...]:
    """Laser-off pictures to take the colour from: those that were taken for it, else all there are."""
    dark = tuple(entry for entry in recording.select(Role.TEXTURE) if not entry.lasers_on)
    return exposed_for_colour(dark) or dark


def coloured(
    cloud: PointCloud,
    rig: Rig,
    recording: Recording,
    textures: Sequence[FrameEntry],
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> PointCloud:
    """The cloud with the colours of pictures: each point's from the one that was taken nearest to its angle.

    Args:
        cloud: table frame, each point with the angle at which it was seen.
        rig: what it was computed with.
        recording: where the pictures lie.
        textures: of its entries.
        progress: told after each picture.

    Raises:
        FrameError: a picture cannot be read.
    """
    turns = np.array([recording.turn_rad(recording.angle_deg(entry) or 0.0) for entry in textures])
    seen = np.radians(cloud.angle_deg.astype(np.float64))
    nearest = _nearest(seen, turns)
    colours = cloud.colours.copy()
    for number, entry in enumerate(textures):
        mine = np.flatnonzero(nearest == number)
        if len(mine):
            image = recording.load(entry).image
            colours[mine] = colours_at_angle(image, rig, cloud.points[mine], float(turns[number]))
        progress(number + 1, len(textures))
    return replace(cloud, colours=colours)


def _nearest(seen: Floats, turns: Floats) -> NDArray[np.intp]:
    """Number of the picture nearest in angle, for each of what may be millions of points."""
    whole = 2.0 * np.pi
    order = np.argsort(turns % whole)
    ring = (turns % whole)[order]
    ring = np.concatenate([[ring[-1] - whole], ring, [ring[0] + whole]])
    numbers = np.concatenate([[order[-1]], order, [order[0]]])
    at = seen % whole
    after = np.clip(np.searchsorted(ring, at), 1, len(ring) - 1)
    is_before = at - ring[after - 1] <= ring[after] - at
    nearest: NDArray[np.intp] = numbers[np.where(is_before, after - 1, after)]
    return nearest
