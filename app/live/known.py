"""What is known of the scanner, as far as live pictures show it; all of it may be missing."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from app.geometry.arrays import Pixels, Points
from app.geometry.rig import Rig
from app.scanning.facing import stripe_orientation
from app.scanning.region import Region, default_region
from app.vision.board import BoardSpec
from app.vision.markers import PlatterSpec
from app.vision.stripe import LaserColour, Orientation

_CIRCLE_POINTS = 181
# Where lasers are told apart: so far before the axis, as a share of its distance from the camera.
_BEFORE_AXIS = 0.05


# No slots, because what is drawn again and again is computed once.
@dataclass(frozen=True, eq=False)
class Known:
    """What is known.

    Attributes:
        colours: of the lasers, by name, in the order of the bench.
        rig: the calibration.
        region: what is scanned; None for what a scan takes by itself.
        board: that is looked for in the pictures.
        platter: markers on the table.
    """

    colours: Mapping[str, LaserColour] = field(default_factory=dict)
    rig: Rig | None = None
    region: Region | None = None
    board: BoardSpec | None = None
    platter: PlatterSpec | None = None

    def orientation(self, laser: str) -> Orientation:
        """Which way its stripe runs; upright where no calibration tells."""
        if self.rig is None or laser not in self.rig.lasers:
            return "vertical"
        return stripe_orientation(self.rig, laser)

    def in_order(self, lasers: Sequence[str]) -> tuple[str, ...]:
        """The lasers in the order in which their stripes lie across; empty names where nobody knows."""
        if len(lasers) < 2:
            return tuple(lasers)
        if self.rig is None or any(laser not in self.rig.lasers for laser in lasers):
            return ("",) * len(lasers)
        return tuple(sorted(lasers, key=self._across))

    def outlines(self, size: tuple[int, int]) -> tuple[Pixels, ...]:
        """The limits of what is scanned and the axis, in pictures of that size; none where it is unknown."""
        if self.rig is None or self.rig.camera.size != size:
            return ()
        return self._outlines

    @cached_property
    def _outlines(self) -> tuple[Pixels, ...]:
        assert self.rig is not None
        region = self.region or default_region(self.rig)
        # A limit that is infinitely far away is not drawn, but the sides must end somewhere.
        radius = region.radius_mm
        if not np.isfinite(radius):
            return ()
        low = region.lowest_mm if np.isfinite(region.lowest_mm) else -radius
        high = region.highest_mm if np.isfinite(region.highest_mm) else low + 2.0 * radius
        bottom, top = self._pixels(_circle(radius, low)), self._pixels(_circle(radius, high))
        sides = [
            np.vstack([bottom[choose(bottom[:, 0])], top[choose(top[:, 0])]])
            for choose in (np.nanargmin, np.nanargmax)
            if np.isfinite(bottom[:, 0]).any() and np.isfinite(top[:, 0]).any()
        ]
        circles = [
            ring
            for ring, limit in ((bottom, region.lowest_mm), (top, region.highest_mm))
            if np.isfinite(limit)
        ]
        return (*circles, *sides)

    def _pixels(self, points: Points) -> Pixels:
        assert self.rig is not None
        return self.rig.camera.project(self.rig.axis.camera_from_table @ points)

    def _across(self, laser: str) -> float:
        """Where the stripe lies across the picture on a surface somewhat before the axis."""
        assert self.rig is not None
        frame = self.rig.axis.camera_from_table
        before_mm = _BEFORE_AXIS * float(np.linalg.norm(frame.translation))
        ends = frame @ np.array([[before_mm, 0.0, 0.0], [before_mm, 1.0, 0.0]])
        is_upright = self.orientation(laser) == "vertical"
        if not is_upright:
            ends = frame @ np.array([[before_mm, 0.0, 0.0], [before_mm, 0.0, 1.0]])
        far = self.rig.lasers[laser].signed_distance(ends)
        share = far[0] / (far[0] - far[1])
        met = ends[:1] + share * (ends[1:] - ends[:1])
        return float(self.rig.camera.project(met)[0, 0 if is_upright else 1])


def _circle(radius_mm: float, height_mm: float) -> Points:
    around = np.linspace(0.0, 2.0 * np.pi, _CIRCLE_POINTS)
    return np.column_stack(
        [radius_mm * np.cos(around), radius_mm * np.sin(around), np.full(_CIRCLE_POINTS, height_mm)]
    )
