"""Points as they are shown: what the eye can tell apart, in 19 bytes each."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from app.geometry.cloud import PointCloud

FULL_SHADE = 200
"""Shade of a surface whose colour is shown as it is."""
_LIGHTS = np.array([[0.41, -0.59, 0.70], [-0.77, 0.26, 0.58]], np.float32)
_NEUTRAL = 200
# Cells per axis that fit into a key of 63 bits.
_KEY_BITS = 21


@dataclass(frozen=True, eq=False, slots=True)
class DisplayPoints:
    """N points in the table frame.

    Attributes:
        points: (N, 3) float32 mm.
        texture: (N, 3) uint8 red, green, blue.
        shade: (N,) uint8 light that falls on the surface; `FULL_SHADE` leaves a colour as it is.
        laser: (N,) uint8 number of the laser.
        turn: (N,) uint8 table angle in 256ths of a turn.
        quality: (N,) uint8, 255 is best.
    """

    points: NDArray[np.float32]
    texture: NDArray[np.uint8]
    shade: NDArray[np.uint8]
    laser: NDArray[np.uint8]
    turn: NDArray[np.uint8]
    quality: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.points)

    @classmethod
    def of(cls, cloud: PointCloud) -> "DisplayPoints":
        """The cloud as it is shown: its finite points, grey where it has no texture."""
        is_finite = np.isfinite(cloud.points)
        if not is_finite.all():
            cloud = cloud.select(np.asarray(is_finite.all(axis=1), np.bool_))
        # A scan that took no colours has black ones.
        texture = cloud.colours if cloud.colours.any() else np.full_like(cloud.colours, _NEUTRAL)
        return cls(
            np.ascontiguousarray(cloud.points, np.float32),
            texture,
            _shade(cloud.normals),
            cloud.laser,
            (np.mod(cloud.angle_deg, 360.0) * (256.0 / 360.0)).astype(np.uint8),
            (np.nan_to_num(np.clip(cloud.quality, 0.0, 1.0)) * 255.0).astype(np.uint8),
        )

    @staticmethod
    def joined(parts: "Sequence[DisplayPoints]") -> "DisplayPoints":
        if not parts:
            return DisplayPoints.of(PointCloud.empty())
        return DisplayPoints(
            np.concatenate([part.points for part in parts]),
            np.concatenate([part.texture for part in parts]),
            np.concatenate([part.shade for part in parts]),
            np.concatenate([part.laser for part in parts]),
            np.concatenate([part.turn for part in parts]),
            np.concatenate([part.quality for part in parts]),
        )

    def select(self, which: NDArray[np.intp] | slice) -> "DisplayPoints":
        return DisplayPoints(
            self.points[which], self.texture[which], self.shade[which],
            self.laser[which], self.turn[which], self.quality[which],
        )  # fmt: skip

    def thinned(self, cell_mm: float) -> "DisplayPoints":
        """The first point of every cube of that side, in the order they had."""
        if not len(self):
            return self
        cells = np.floor(self.points / cell_mm).astype(np.int64)
        cells -= cells.min(axis=0)
        np.minimum(cells, (1 << _KEY_BITS) - 1, out=cells)
        key = (cells[:, 0] << (2 * _KEY_BITS)) | (cells[:, 1] << _KEY_BITS) | cells[:, 2]
        _, first = np.unique(key, return_index=True)
        return self if len(first) == len(self) else self.select(np.sort(first))

    def parts(self, most: int) -> "list[DisplayPoints]":
        """The points in their order, in equal parts of at most so many."""
        count = -(-len(self) // most)
        edges = np.linspace(0, len(self), count + 1).astype(int)
        return [self.select(slice(start, stop)) for start, stop in pairwise(edges.tolist())]


def _shade(normals: NDArray[np.float32]) -> NDArray[np.uint8]:
    towards = np.maximum(normals @ _LIGHTS.T, 0.0)
    light = 0.38 + 0.85 * towards[:, 0] + 0.25 * towards[:, 1]
    light[np.einsum("ij,ij->i", normals, normals) == 0.0] = 1.0
    shade: NDArray[np.uint8] = np.minimum(light * FULL_SHADE, 255.0).astype(np.uint8)
    return shade
