"""Points as viser's nodes, below the table so that they turn with it."""

import numpy as np
from numpy.typing import NDArray
from viser import PointCloudHandle, ViserServer

from app.viewer.colouring import Colouring
from app.viewer.crop import CropBox
from app.viewer.display import DisplayPoints
from app.viewer.stage import TABLE

SCAN = f"{TABLE}/scan"
_NEWEST = f"{SCAN}/newest"
_NEWEST_COLOUR = (255, 64, 48)
# Neighbours of a thinned cloud then just touch.
_SIZE_OF_CELL = 1.3


class ViserCloud:
    """Draws the nodes of a cloud.

    Attributes:
        colouring: of the points that are drawn from now on.
        size_mm: of a point; larger where points were left out.
        crop: what alone is drawn from now on; everything where there is none.
    """

    def __init__(self, server: ViserServer) -> None:
        self._server = server
        self._handles: dict[str, PointCloudHandle] = {}
        self._cells: dict[str, float] = {}
        self._newest: PointCloudHandle | None = None
        self.colouring = Colouring()
        self.size_mm = 0.6
        self.crop: CropBox | None = None

    def draw(self, name: str, shown: DisplayPoints, cell_mm: float, *, is_exact: bool) -> None:
        shown = self._within(shown)
        # Half floats are finer near the node's own origin.
        origin = _middle(shown)
        self._cells[name] = cell_mm
        self._handles[name] = self._server.scene.add_point_cloud(
            f"{SCAN}/{name}",
            shown.points - origin,
            self.colouring.colours(shown),
            point_size=self._size(cell_mm),
            point_shape="circle",
            point_shading="flat",
            precision="float32" if is_exact else "float16",
            position=origin,
        )

    def erase(self, name: str) -> None:
        self._handles.pop(name).remove()
        del self._cells[name]

    def resize(self, size_mm: float) -> None:
        """Draw every point larger or smaller."""
        self.size_mm = size_mm
        for name, handle in self._handles.items():
            handle.point_size = self._size(self._cells[name])

    def highlight(self, shown: DisplayPoints) -> None:
        """Mark the points that came last."""
        shown = self._within(shown)
        origin = _middle(shown)
        self._newest = self._server.scene.add_point_cloud(
            _NEWEST, shown.points - origin, _NEWEST_COLOUR, point_size=2.0 * self.size_mm,
            point_shape="circle", point_shading="flat", position=origin,
        )  # fmt: skip

    def unmark(self) -> None:
        """Take the mark away."""
        if self._newest is not None:
            self._newest.remove()
            self._newest = None

    def _within(self, shown: DisplayPoints) -> DisplayPoints:
        return shown if self.crop is None else self.crop.of(shown)

    def _size(self, cell_mm: float) -> float:
        return max(self.size_mm, _SIZE_OF_CELL * cell_mm)


def _middle(shown: DisplayPoints) -> NDArray[np.float32]:
    middle: NDArray[np.float32] = shown.points.mean(axis=0) if len(shown) else np.zeros(3, np.float32)
    return middle
