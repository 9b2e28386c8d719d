"""A picture with the colours of a surface, finer than its triangles."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Self, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from app.errors import SurfaceError
from app.geometry.arrays import Floats, Points
from app.geometry.cloud import PointCloud
from app.geometry.mesh import TriangleMesh
from app.surface.colours import colours_at
from app.surface.neighbours import Places, is_finite

_SMALLEST_PX, _LARGEST_PX = 4, 1024
# Two triangles share a square. This much of its edge keeps their colours apart where they are blurred.
_ROOM_PX = 4
_COARSER = 1.25
_AT_ONCE = 500_000
_BACKGROUND = 200
_CURVE_BITS = 16
Pixels: TypeAlias = NDArray[np.int64]


@dataclass(frozen=True, eq=False, slots=True)
class Texture:
    """A picture of all triangles of a mesh, side by side.

    Attributes:
        image: (H, W, 3) uint8 red, green, blue.
        corners: (F, 3, 2) float32: where in it the corners of each triangle are, 0..1 to the right and down.
    """

    image: NDArray[np.uint8]
    corners: NDArray[np.float32]

    def png(self) -> bytes:
        """The picture as a file."""
        found = cv2.imencode(".png", self.image[:, :, ::-1])[1]
        return found.tobytes()


def paint_texture(
    mesh: TriangleMesh,
    cloud: PointCloud,
    side_px: int,
    progress: Callable[[float], None] = lambda share: None,
) -> Texture:
    """Paint every triangle with the colours of the points around, as finely as the points lie.

    Args:
        mesh: with triangles.
        cloud: that it was made of.
        side_px: of the picture, at most; a power of two is used.
        progress: told how much of it is done, 0..1.

    Raises:
        SurfaceError: there are too many triangles for so small a picture, or no points.
    """
    known = is_finite(cloud.points)
    places = Places.of(cloud.points[known])
    if not len(places) or not len(mesh):
        raise SurfaceError("There are no points to take colours from.")
    corners = mesh.corners()
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    layout = _Layout.fitting(longest, max(places.spacing_mm(), 1e-6), side_px)
    colours = cloud.colours[known][places.first]
    image = np.full((*layout.shape, 3), _BACKGROUND, np.uint8)
    done = 0
    for rows, columns, points in layout.pieces(corners):
        image[rows, columns] = colours_at(points.reshape(-1, 3), places.tree, colours).reshape(points.shape)
        done += points.size // 3
        progress(done / layout.pixels)
    return Texture(image, layout.corners())


@dataclass(frozen=True, eq=False, slots=True)
class _Layout:
    """Squares in a picture, two triangles in each: the larger ones first, each beside the one before.

    Attributes:
        triangles: (S, 2) which; the last square may have one twice.
        size_px: (S,) edge of each square, a power of two.
        left_px, top_px: (S,) its first column and row.
    """

    triangles: NDArray[np.intp]
    size_px: Pixels
    left_px: Pixels
    top_px: Pixels

    @classmethod
    def fitting(cls, longest_mm: Floats, pixel_mm: float, side_px: int) -> Self:
        """For triangles with these longest edges (F,); pixels of that size, or as large as must be."""
        side = 1 << (side_px.bit_length() - 1)
        while True:
            wanted = np.ceil(np.log2(longest_mm / pixel_mm + _ROOM_PX)).astype(np.int64)
            size = np.clip(1 << np.clip(wanted, 0, 20), _SMALLEST_PX, _LARGEST_PX)
            order = np.argsort(-size, kind="stable")
            largest = size[order[::2]]
            if int(np.sum(largest**2)) <= side**2 and largest[0] <= side:
                break
            if largest[0] == _SMALLEST_PX:
                raise SurfaceError(
                    f"{len(longest_mm):,} triangles are too many for a texture of {side} pixels a side.",
                    "Name a larger one, or make fewer triangles.",
                )
            pixel_mm *= _COARSER
        pairs = np.append(order, order[-1:])[: 2 * len(largest)].reshape(-1, 2)
        # Along a curve that fills a square before it goes on to the next, nothing is left between.
        cells = (largest // _SMALLEST_PX) ** 2
        across, down = _along_curve(np.cumsum(cells) - cells)
        return cls(pairs, largest, _SMALLEST_PX * across, _SMALLEST_PX * down)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the picture."""
        return int((self.top_px + self.size_px).max()), int((self.left_px + self.size_px).max())

    @property
    def pixels(self) -> int:
        """In all squares."""
        return int(np.sum(self.size_px**2))

    def corners(self) -> NDArray[np.float32]:
        """(F, 3, 2) as `Texture.corners`."""
        found = np.empty((int(self.triangles.max()) + 1, 3, 2))
        size = self.size_px.astype(np.float64)
        leg = size - _ROOM_PX
        height, width = self.shape
        for half, start, step in ((0, 1.0 + 0.0 * size, leg), (1, size - 1.0, -leg)):
            for corner, (right, down) in enumerate(((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))):
                found[self.triangles[:, half], corner, 0] = (self.left_px + start + right * step) / width
                found[self.triangles[:, half], corner, 1] = (self.top_px + start + down * step) / height
        return found.astype(np.float32)

    def pieces(self, corners: Points) -> Iterator[tuple[Pixels, Pixels, Points]]:
        """All pixels: rows (K, E, 1), columns (K, 1, E), and the places (K, E, E, 3) mm that they show."""
        for edge in np.unique(self.size_px).tolist():
            squares, shares = np.flatnonzero(self.size_px == edge), _shares(edge)
            step = max(1, _AT_ONCE // edge**2)
            for start in range(0, len(squares), step):
                which = squares[start : start + step]
                rows = self.top_px[which, None, None] + np.arange(edge)[:, None]
                columns = self.left_px[which, None, None] + np.arange(edge)
                yield rows, columns, np.einsum("ijhk,shkc->sijc", shares, corners[self.triangles[which]])


def _shares(edge: int) -> Floats:
    """(E, E, 2, 3) how much each corner of both triangles counts at each pixel of their square."""
    down, right = np.indices((edge, edge)) + 0.5
    is_second = right + down > edge
    u, v = (
        np.where(is_second, edge - 1.0 - way, way - 1.0) / max(edge - _ROOM_PX, 1) for way in (right, down)
    )
    if edge == _SMALLEST_PX:
        # No room for more than the triangle's middle.
        u, v = np.full((2, edge, edge), 1.0 / 3.0)
    # Outside of it, a pixel shows what is nearest on the rim, so that no other colour blurs in.
    u, v = np.maximum(u, 0.0), np.maximum(v, 0.0)
    beyond = np.maximum(u + v, 1.0)
    u, v = u / beyond, v / beyond
    of_one = np.stack([1.0 - u - v, u, v], axis=2)
    return np.stack([of_one * ~is_second[..., None], of_one * is_second[..., None]], axis=2)


def _along_curve(steps: Pixels) -> tuple[Pixels, Pixels]:
    """Cells to the right and down after so many steps along Morton's curve."""
    across, down = np.zeros_like(steps), np.zeros_like(steps)
    for bit in range(_CURVE_BITS):
        across |= (steps >> (2 * bit) & 1) << bit
        down |= (steps >> (2 * bit + 1) & 1) << bit
    return across, down
