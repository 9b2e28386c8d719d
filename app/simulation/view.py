"""What the camera sees before lasers and noise: what never changes, and a part that does."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.simulation.layers import F32, Box, Layers, area
from app.simulation.mesh import Mesh


@dataclass(frozen=True, eq=False, slots=True)
class View:
    """What the camera sees at one angle of the table, before lasers and noise.

    Attributes:
        still: what never changes, over the whole picture.
        still_ambient: (H, W, C) grey levels of it in the room's light.
        part: a part of the picture as it is now.
        box: a little less: where `part_ambient` is right.
        part_ambient: (h, w, C) grey levels in the box.
        meshes: every body that moves, camera frame.
    """

    still: Layers
    still_ambient: F32
    part: Layers
    box: Box
    part_ambient: F32
    meshes: tuple[Mesh, ...]

    @property
    def depth(self) -> F32:
        """(H, W) mm along z, infinite where nothing is."""
        return _pasted(self.still.depth, self.part.box, self.part.depth)

    @property
    def owner(self) -> NDArray[np.int32]:
        """(H, W) number of the triangle seen there, counted over all bodies; -1 for none."""
        return _pasted(self.still.owner, self.part.box, self.part.owner)

    @property
    def normal(self) -> F32:
        """(H, W, 3) unit vectors out of the surface, camera frame."""
        return _pasted(self.still.normal, self.part.box, self.part.normal)

    @property
    def albedo(self) -> F32:
        """(H, W, 3) blue, green, red, 0..1."""
        return _pasted(self.still.albedo, self.part.box, self.part.albedo)

    @property
    def ambient(self) -> F32:
        """(H, W, C) grey levels in the room's light."""
        return _pasted(self.still_ambient, self.box, self.part_ambient)


def _pasted(picture: NDArray, box: Box, part: NDArray) -> NDArray:  # type: ignore[type-arg]
    whole = picture.copy()
    whole[area(box)] = part
    return whole
