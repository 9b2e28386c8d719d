"""What the laser draws on the empty scene, so that it can be left out of the scan."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.vision.stripe import LaserStripe, Orientation

# A stripe on the empty scene is found again within this, px.
_SAME_PLACE_PX = 2.0


@dataclass(frozen=True, eq=False, slots=True)
class Background:
    """Stripes on the scene without the object.

    A point on the same pixel under the same laser is the same point in space, so nothing of the object is
    lost but where it touches the scene.

    Attributes:
        stripes: positions across each line, by laser: (lines, pictures), NaN where there was none.
    """

    stripes: Mapping[str, NDArray[np.float32]]

    @classmethod
    def of(
        cls, seen: list[tuple[str, LaserStripe]], orientations: Mapping[str, Orientation], lines: int
    ) -> "Background":
        """From the stripes of all background frames, each with its laser; `lines`: the longer image side."""
        stacks: dict[str, list[NDArray[np.float32]]] = {}
        for laser, stripe in seen:
            column = np.full(lines, np.nan, np.float32)
            column[stripe.line] = _across(stripe, orientations[laser])
            stacks.setdefault(laser, []).append(column)
        return cls({laser: np.column_stack(stack) for laser, stack in stacks.items()})

    def without(self, laser: str, stripe: LaserStripe, orientation: Orientation) -> LaserStripe:
        """The points of a stripe that were not there without the object."""
        if laser not in self.stripes or not len(stripe):
            return stripe
        distance = np.abs(self.stripes[laser][stripe.line] - _across(stripe, orientation)[:, None])
        is_old = np.any(np.nan_to_num(distance, nan=np.inf) <= _SAME_PLACE_PX, axis=1)
        return stripe.select(~is_old)


def _across(stripe: LaserStripe, orientation: Orientation) -> NDArray[np.float32]:
    across: NDArray[np.float32] = stripe.pixels[:, 0 if orientation == "vertical" else 1].astype(np.float32)
    return across
