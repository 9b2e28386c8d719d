"""Where a scan lies, from places that a person has shown in two."""

from collections.abc import Sequence

import numpy as np

from app.errors import SurfaceError
from app.geometry.arrays import Points
from app.geometry.transform import RigidTransform
from app.surface.joining.options import PairedPlaces

_FEWEST = 3
_LEAST_SPREAD = 0.05


def clicked_pose(pairs: Sequence[PairedPlaces], name: str) -> RigidTransform:
    """The first scan's frame from that of the scan the pairs belong to.

    Args:
        name: of the scan, for messages.

    Raises:
        SurfaceError: there are fewer than three, or they lie on a line.
    """
    if len(pairs) < _FEWEST:
        raise SurfaceError(
            f"{name} has {len(pairs)} pairs of places; {_FEWEST} are the fewest.",
            "Show three places or more that both scans have, far from each other.",
        )
    here = np.array([pair.here for pair in pairs])
    there = np.array([pair.there for pair in pairs])
    if min(_spread(here), _spread(there)) < _LEAST_SPREAD:
        raise SurfaceError(
            f"The pairs of places of {name} lie on a line.", "Show one more place, beside that line."
        )
    return best_motion(here, there)


def best_motion(here: Points, there: Points) -> RigidTransform:
    """The rigid motion that brings (N, 3) points nearest to their partners."""
    middle_here, middle_there = here.mean(axis=0), there.mean(axis=0)
    u, _, vt = np.linalg.svd((there - middle_there).T @ (here - middle_here))
    rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    return RigidTransform(rotation, middle_there - rotation @ middle_here)


def _spread(places: Points) -> float:
    """How wide places are for their length: 0 on a line."""
    sizes = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)
    return float(sizes[1] / sizes[0]) if sizes[0] > 0.0 else 0.0
