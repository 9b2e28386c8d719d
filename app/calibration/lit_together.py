"""Two lasers lit in one picture: which stripe is whose, on either side of where the lasers cross."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Points
from app.geometry.plane import LaserPlane, fit_plane

_MOST_TRIALS = 200
_POINTS = 30


def swapped_pairs(pairs: Sequence[tuple[Points, Points]], across: int) -> NDArray[np.bool_]:
    """Which pairs of stripes to swap so that all first ones lie on one plane and all second on another.

    Every two pairs, taken straight and crossed, propose two planes; those that explain all pairs best win.
    The first plane is that of the laser further left (further up, for stripes across the picture), which is
    where its plane passes beside the lens.

    Args:
        pairs: for each view, the points of two stripes (N, 3) mm in the camera frame, in any order.
        across: 0 for stripes that run down the picture, else 1.

    Returns:
        (V,) mask.
    """
    few = [(_thinned(first), _thinned(second)) for first, second in pairs]
    best = np.zeros(len(few), np.bool_)
    if len(few) < 2:
        return best
    least = np.inf
    trials = list(combinations(range(len(few)), 2))
    for i, j in trials[:: max(1, len(trials) // _MOST_TRIALS)]:
        for is_crossed in (False, True):
            a = fit_plane(np.concatenate([few[i][0], few[j][int(is_crossed)]])).plane
            b = fit_plane(np.concatenate([few[i][1], few[j][1 - int(is_crossed)]])).plane
            straight = np.array([_off(a, first) + _off(b, second) for first, second in few])
            crossed = np.array([_off(a, second) + _off(b, first) for first, second in few])
            # The median of views: one that shows a reflection has no say.
            cost = float(np.median(np.minimum(straight, crossed)))
            if cost < least:
                least, best = cost, (crossed < straight) ^ _is_beyond(a, b, across)
    return best


def _thinned(points: Points) -> Points:
    return points[:: max(1, len(points) // _POINTS)]


def _off(plane: LaserPlane, points: Points) -> float:
    return float(np.median(np.abs(plane.signed_distance(points))))


def _is_beyond(first: LaserPlane, second: LaserPlane, across: int) -> bool:
    """Whether the first plane passes the lens on the far side of the second."""
    places = [plane.distance_mm / plane.normal[across] for plane in (first, second)]
    return bool(places[0] > places[1])
