"""Which side of the picture a laser's stripe can lie on, and which way it runs there."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats, Pixels, unit
from app.geometry.plane import LaserPlane
from app.geometry.rig import Rig
from app.vision.stripe import Image, LaserStripe, LaserView, Orientation

# Nearer than this to the line that parts the lasers a point may belong to either, px.
_UNSURE_PX = 3.0


def facing_plane(rig: Rig) -> LaserPlane:
    """The plane through the axis that faces the camera: what lies nearer than it is the object's front."""
    frame = rig.axis.camera_from_table
    return LaserPlane.through(frame.translation, frame.rotation[:, 0])


def stripe_orientation(rig: Rig, laser: str) -> Orientation:
    """Which way the stripe runs on a surface at the axis that faces the camera."""
    facing = facing_plane(rig)
    along = unit(np.cross(rig.lasers[laser].normal, facing.normal))
    origin = rig.axis.origin
    ends: Pixels = rig.camera.project(np.vstack([origin - along, origin + along]))
    du, dv = np.abs(ends[1] - ends[0])
    return "horizontal" if du > dv else "vertical"


@dataclass(frozen=True, eq=False, slots=True)
class LaserSides:
    """Tells the stripes of several lasers in one picture apart.

    Assumed: the surface lies in front of the axis, as seen from the camera. There a laser from the left has
    its stripe left of where its sheet passes the axis, one from the right on the other side. Pixels that
    both lasers could reach that way are given to neither, so surfaces behind the axis are lost.

    Attributes:
        mask: for every laser (H, W), where only it can have its stripe.
    """

    mask: dict[str, NDArray[np.bool_]]

    @classmethod
    def of(cls, rig: Rig, lasers: tuple[str, ...]) -> "LaserSides":
        """For lasers that are lit together."""
        width, height = rig.camera.size
        u, v = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
        rays = rig.camera.rays(np.column_stack([u.ravel(), v.ravel()]))
        facing = facing_plane(rig)
        camera_side = np.sign(-facing.distance_mm)
        reach = {}
        for laser in lasers:
            hits = rig.lasers[laser].intersect_rays(rays)
            reach[laser] = (camera_side * facing.signed_distance(hits) > 0.0).reshape(height, width)
        alone = {
            laser: reach[laser] & ~np.any([reach[other] for other in lasers if other != laser], axis=0)
            for laser in lasers
        }
        return cls(alone)

    def view_of(self, laser: str, view: LaserView) -> LaserView:
        """The view with everything outside the laser's side made to look unlit."""
        mask = self.mask[laser]
        if view.dark is not None:
            here = mask if view.lit.ndim == 2 else mask[:, :, None]
            return LaserView(np.where(here, view.lit, view.dark), view.dark, view.colour, view.orientation)
        lit = view.lit if view.orientation == "vertical" else np.swapaxes(view.lit, 0, 1)
        lines = mask if view.orientation == "vertical" else mask.T
        levelled = _levelled(lit, lines)
        if view.orientation == "horizontal":
            levelled = np.ascontiguousarray(np.swapaxes(levelled, 0, 1))
        return LaserView(levelled, None, view.colour, view.orientation)

    def only(self, laser: str, stripe: LaserStripe, orientation: Orientation) -> LaserStripe:
        """The points of a stripe that surely lie on the laser's side."""
        step = np.array([_UNSURE_PX, 0.0] if orientation == "vertical" else [0.0, _UNSURE_PX])
        inside = self._at(laser, stripe.pixels - step) & self._at(laser, stripe.pixels + step)
        return stripe.select(inside)

    def _at(self, laser: str, pixels: Floats) -> NDArray[np.bool_]:
        height, width = self.mask[laser].shape
        u = np.clip(np.rint(pixels[:, 0]).astype(np.intp), 0, width - 1)
        v = np.clip(np.rint(pixels[:, 1]).astype(np.intp), 0, height - 1)
        here: NDArray[np.bool_] = self.mask[laser][v, u]
        return here


def _levelled(lit: Image, lines: NDArray[np.bool_]) -> Image:
    """The masked part of every line at the median of what is kept, so that no edge appears."""
    out = lit.copy()
    for row, keep in zip(out, lines, strict=True):
        if not keep.all():
            row[~keep] = np.median(row[keep], axis=0) if keep.any() else 0
    return out
