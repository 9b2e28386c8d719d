"""Names for the arrays that travel between the modules."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Matrix3: TypeAlias = NDArray[np.float64]
"""(3, 3)."""
Vector3: TypeAlias = NDArray[np.float64]
"""(3,)."""
Pixels: TypeAlias = NDArray[np.float64]
"""(N, 2) as (u, v): column, row; the centre of the first pixel is (0, 0)."""
Points: TypeAlias = NDArray[np.float64]
"""(N, 3), millimetres."""
Rays: TypeAlias = NDArray[np.float64]
"""(N, 3) in the camera frame, scaled to z = 1."""


def unit(vector: Vector3) -> Vector3:
    """The vector scaled to length one.

    Raises:
        ValueError: the vector has no direction.
    """
    length = float(np.linalg.norm(vector))
    if not np.isfinite(length) or length == 0.0:
        raise ValueError("a direction must have a finite length above zero")
    return np.asarray(vector, np.float64) / length
