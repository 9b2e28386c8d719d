"""A laser's light on a scene."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.simulation import kernels
from app.simulation.layers import F32, Box, Layers, area, blur_reach, blurred, grown
from app.simulation.mesh import Mesh
from app.simulation.scene import Scene
from app.simulation.sheet import FAN_BINS, Sheet

# How strongly blue, green and red pixels see each laser; the leak gives a bright stripe its white core.
TINTS = {
    "red": (0.035, 0.075, 1.0),
    "green": (0.10, 1.0, 0.07),
    "blue": (1.0, 0.16, 0.03),
    "any": (1.0, 1.0, 1.0),
}


@dataclass(frozen=True, eq=False, slots=True)
class Glow:
    """What a laser adds to the part of the picture that it reaches, without speckle and clipping.

    Attributes:
        box: the part.
        light: (h, w) grey levels.
    """

    box: Box
    light: F32

    def whole(self, size: tuple[int, int]) -> F32:
        """The same over a picture of that height and width."""
        picture = np.zeros(size, np.float32)
        picture[area(self.box)] = self.light
        return picture


class Beam:
    """One laser, with everything computed that does not change from picture to picture.

    Args:
        scene: what it shines on.
        laser: its name.
        still: what is seen of the bodies that never change.
        meshes: these bodies, camera frame.
    """

    def __init__(self, scene: Scene, laser: str, still: Layers, meshes: Sequence[Mesh]) -> None:
        self._source, self._plane = scene.scanner.sources[laser], scene.scanner.rig.lasers[laser]
        self._blur_px = scene.lens_blur_px
        self._sheet = Sheet.of(scene, self._source, self._plane.normal)
        colour = np.asarray(TINTS[self._source.colour], np.float32)
        self._colour = colour / colour.sum()
        self._still = still
        reach = np.full((len(self._sheet.offsets_mm), FAN_BINS), np.inf, np.float32)
        self._reach = self._cut(reach, meshes)
        self._rows, self._columns = self._near(still)

    def glow(self, part: Layers, meshes: Sequence[Mesh]) -> Glow:
        """The light on a picture that differs from the still one in a part, for these bodies."""
        reach = self._cut(self._reach.copy(), meshes)
        top, bottom, left, right = part.box
        rows, columns = self._rows, self._columns
        is_still = (rows < top) | (rows >= bottom) | (columns < left) | (columns >= right)
        rows, columns = rows[is_still], columns[is_still]
        still = self._light(self._still, rows, columns, reach)
        near_rows, near_columns = self._near(part)
        near = self._light(part, near_rows, near_columns, reach)
        return self._gathered(
            np.concatenate([rows, near_rows + np.int32(top)]),
            np.concatenate([columns, near_columns + np.int32(left)]),
            np.concatenate([still, near]),
        )

    def _gathered(self, rows: NDArray[np.int32], columns: NDArray[np.int32], grey: F32) -> Glow:
        is_lit = grey > 0.0
        rows, columns, grey = rows[is_lit], columns[is_lit], grey[is_lit]
        if not len(rows):
            return Glow((0, 0, 0, 0), np.zeros((0, 0), np.float32))
        tight = int(rows.min()), int(rows.max()) + 1, int(columns.min()), int(columns.max()) + 1
        height, width = self._still.depth.shape
        box = grown(tight, blur_reach(self._blur_px) + 1, (height, width))
        light = np.zeros((box[1] - box[0], box[3] - box[2]), np.float32)
        light[rows - box[0], columns - box[2]] = grey
        return Glow(box, blurred(light, self._blur_px))

    def _near(self, layers: Layers) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        source = self._source
        thickest = source.sigma_mm * np.sqrt(1.0 + (source.focus_mm / source.focus_depth_mm) ** 2)
        rows, columns = kernels.near(
            layers.rays, layers.depth, self._plane.normal, self._plane.distance_mm, 4.5 * thickest + 0.05
        )
        return rows, columns

    def _cut(self, reach: F32, meshes: Sequence[Mesh]) -> F32:
        """Lower `reach` to where the light meets these bodies."""
        source, sheet = self._source, self._sheet
        for mesh in meshes:
            kernels.cut(
                mesh.vertices, mesh.faces, self._plane.normal, self._plane.distance_mm, source.position_mm,
                sheet.forward, sheet.sideways, sheet.offsets_mm, source.half_fan_rad,
                sheet.cosine, sheet.sine, reach,
            )  # fmt: skip
        return reach

    def _light(self, layers: Layers, rows: NDArray[np.int32], columns: NDArray[np.int32], reach: F32) -> F32:
        source, sheet = self._source, self._sheet
        grey = np.zeros(len(rows), np.float32)
        kernels.light(
            layers.rays, layers.depth, layers.normal, layers.albedo, rows, columns, self._colour,
            self._plane.normal, self._plane.distance_mm, source.position_mm, sheet.forward, sheet.sideways,
            sheet.offsets_mm, source.half_fan_rad, reach, source.sigma_mm, source.focus_mm,
            source.focus_depth_mm, source.peak_grey, grey,
        )  # fmt: skip
        return grey
