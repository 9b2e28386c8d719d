"""Points drawn as small squares, the nearest on top, shaded so that the shape can be read."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Vector3
from app.geometry.cloud import PointCloud

Canvas = NDArray[np.uint8]
"""(H, W, 3) blue, green, red."""

PAPER = (250, 248, 246)
_CELL_PX = 8
_BIGGEST_SPLAT = 9
_AMBIENT = 0.45
_UNKNOWN_SHADE = 0.8
# Light comes over the viewer's left shoulder: right, up, towards the viewer.
_LIGHT = np.array([-0.45, 0.6, 0.66])
_EDGE_MM = 2.0
_EDGE_ON, _ENOUGH_FACING = -0.15, 0.1
_EDGE_DARKNESS = 0.55
# Scans are often dark: colours are brightened until their bright end has this value.
_BRIGHT, _BRIGHT_PERCENTILE, _MOST_GAIN = 225.0, 95.0, 5.0


@dataclass(frozen=True, eq=False, slots=True)
class View:
    """A parallel projection.

    Attributes:
        name: what a person calls it.
        right, up: unit vectors of the table frame that run right and up in the picture.
        labels: names of the two axes that `right` and `up` run along.
    """

    name: str
    right: Vector3
    up: Vector3
    labels: tuple[str, str]

    @property
    def towards(self) -> Vector3:
        """Unit vector from the object to the viewer."""
        towards: Vector3 = np.cross(self.right, self.up)
        return towards


def splatted(
    cloud: PointCloud, view: View, centre: Vector3, mm_per_px: float, size: tuple[int, int]
) -> Canvas:
    """The cloud seen from one side.

    Args:
        cloud: table frame.
        centre: (3,) mm, what lies in the middle of the picture.
        mm_per_px: scale.
        size: width and height in pixels.
    """
    width, height = size
    canvas = np.empty((height, width, 3), np.uint8)
    canvas[:] = PAPER
    relative = cloud.points - centre.astype(np.float32)
    u = np.rint(relative @ view.right / mm_per_px + width / 2).astype(np.intp)
    v = np.rint(height / 2 - relative @ view.up / mm_per_px).astype(np.intp)
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    # The far wall of a thing shows its back; seen between the points of the near one it looks like dirt.
    faces_us = cloud.normals @ view.towards.astype(np.float32) > _EDGE_ON
    if np.count_nonzero(inside & faces_us) > _ENOUGH_FACING * np.count_nonzero(inside):
        inside &= faces_us
    if not inside.any():
        return canvas
    u, v, depth = u[inside], v[inside], (relative @ view.towards)[inside].astype(np.float32)
    colours = _shaded(cloud.select(inside), view)
    order = np.argsort(depth, kind="stable")
    u, v, depth, colours = u[order], v[order], depth[order], colours[order]
    nearest = np.full((height, width), -np.inf, np.float32)
    side = _splat_side(u, v, size)
    for dv in range(-(side // 2), side - side // 2):
        for du in range(-(side // 2), side - side // 2):
            _lay(
                canvas, nearest, np.clip(u + du, 0, width - 1), np.clip(v + dv, 0, height - 1), depth, colours
            )
    return _with_edges(canvas, nearest)


def _lay(
    canvas: Canvas, nearest: NDArray[np.float32], u: NDArray[np.intp], v: NDArray[np.intp],
    depth: NDArray[np.float32], colours: NDArray[np.uint8],
) -> None:  # fmt: skip
    """Points in the order of their depth, farthest first: of those on one pixel the last one stays."""
    height, width = nearest.shape
    last = np.full(height * width, -1, np.intp)
    last[v * width + u] = np.arange(len(u))
    there = np.flatnonzero(last >= 0)
    chosen = last[there]
    is_nearer = depth[chosen] > nearest.ravel()[there]
    there, chosen = there[is_nearer], chosen[is_nearer]
    nearest.reshape(-1)[there] = depth[chosen]
    canvas.reshape(-1, 3)[there] = colours[chosen]


def _splat_side(u: NDArray[np.intp], v: NDArray[np.intp], size: tuple[int, int]) -> int:
    """So large that neighbouring points of one surface touch."""
    cells = np.unique((v // _CELL_PX) * (size[0] // _CELL_PX + 1) + u // _CELL_PX)
    area = len(cells) * _CELL_PX**2
    return int(np.clip(np.ceil(1.5 * np.sqrt(2.0 * area / len(u))), 1, _BIGGEST_SPLAT))


def _shaded(cloud: PointCloud, view: View) -> NDArray[np.uint8]:
    """Blue, green, red (N, 3): the colour, brighter where the surface faces the light."""
    facing = cloud.normals @ np.column_stack([view.right, view.up, view.towards])
    is_known = np.any(cloud.normals != 0.0, axis=1)
    # The back of a surface that is open towards the viewer is lit as its front would be.
    facing = np.where(facing[:, 2:] < 0.0, -facing, facing)
    light = np.clip(facing @ (_LIGHT / np.linalg.norm(_LIGHT)), 0.0, 1.0)
    shade = np.where(is_known, _AMBIENT + (1.0 - _AMBIENT) * light, _UNKNOWN_SHADE)
    brightest = float(np.percentile(cloud.colours, _BRIGHT_PERCENTILE))
    gain = min(max(_BRIGHT / max(brightest, 1.0), 1.0), _MOST_GAIN)
    colours = cloud.colours[:, ::-1].astype(np.float64) * gain * shade[:, None]
    return np.clip(colours, 0, 255).astype(np.uint8)


def _with_edges(canvas: Canvas, nearest: NDArray[np.float32]) -> Canvas:
    """Darker where something lies nearer beside it: edges and creases stand out without any normals."""
    is_drawn = np.isfinite(nearest)
    depth = np.where(is_drawn, nearest, np.float32(-1e6))
    raised = np.asarray(cv2.dilate(depth, np.ones((3, 3), np.uint8)), np.float32)
    step = np.where(is_drawn, np.clip((raised - depth) / _EDGE_MM, 0.0, 1.0), 0.0)
    dark = 1.0 - _EDGE_DARKNESS * step[:, :, None]
    return np.asarray(np.where(is_drawn[:, :, None], canvas * dark, canvas), np.uint8)
