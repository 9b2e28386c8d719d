"""What colour a place has between points of known colours."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Points

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

_NEIGHBOURS = 4


def colours_at(places: Points, tree: "cKDTree", colours: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(V, 3) red, green, blue: the mean of the nearest points', the nearer the more.

    Args:
        places: (V, 3) mm.
        tree: of the points.
        colours: (N, 3) theirs.
    """
    count = min(_NEIGHBOURS, tree.n)
    distances, which = tree.query(places, k=np.arange(1, count + 1), workers=-1)
    weight = 1.0 / np.maximum(distances, 1e-6)
    weight /= weight.sum(axis=1, keepdims=True)
    mixed: NDArray[np.uint8] = np.rint(np.einsum("vn,vnc->vc", weight, colours[which])).astype(np.uint8)
    return mixed
