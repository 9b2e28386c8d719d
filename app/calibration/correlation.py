"""How far neighbouring observations err together, so that many of them are not trusted like many."""

import numpy as np
from numpy.typing import NDArray

from app.calibration.bundle import Corners, Stripes
from app.geometry.arrays import Floats

_BLOCK = 16
_OUTLIER = 4.0
_FEWEST_BLOCKS = 20


def correlation_of_groups(r: Floats, corners: Corners, stripes: Stripes) -> Floats:
    """By what the variance of a mean of neighbours exceeds that of independent ones; one or more per group.

    Sums over blocks of sixteen neighbours, one of which is a row or two of corners or a piece of stripe, are
    compared with what independent residuals of the same size would give (the method of batch means).

    Args:
        r: (2 Nc + Ns,) residuals, corners first, in units of their standard deviation.
    """
    n = 2 * len(corners.pixels)
    keys = np.concatenate(
        [
            # u and v of a corner are sequences of their own.
            *(_keys(corners.group, corners.body, corners.angle, axis) for axis in (0, 1)),
            _keys(stripes.group, stripes.body, stripes.angle, stripes.laser),
        ]
    )
    ordered = np.concatenate([r[0:n:2], r[1:n:2], r[n:]])
    ordered = np.where(np.abs(ordered) < _OUTLIER, ordered, 0.0)
    block = _blocks(keys)
    sums = np.bincount(block, ordered, minlength=1)
    squares = np.bincount(block, ordered**2, minlength=1)
    group = np.zeros(len(sums), np.intp)
    group[block] = keys[:, 0]
    found = np.ones(1 + int(keys[:, 0].max(initial=0)))
    for number in range(len(found)):
        mine = group == number
        expected = float(squares[mine].sum())
        if np.count_nonzero(mine) >= _FEWEST_BLOCKS and expected > 0.0:
            found[number] = max(1.0, float(np.sum(sums[mine] ** 2)) / expected)
    return found


def _keys(group: NDArray[np.intp], body: NDArray[np.intp], angle: NDArray[np.intp],
          last: NDArray[np.intp] | int) -> NDArray[np.intp]:  # fmt: skip
    """(N, 4) what all members of one sequence share."""
    return np.column_stack([group, body, angle, np.broadcast_to(last, group.shape)]).astype(np.intp)


def _blocks(keys: NDArray[np.intp]) -> NDArray[np.intp]:
    """Number of the block (N,) of each member: neighbours with the same keys, sixteen at most."""
    n = len(keys)
    starts = np.ones(n, np.bool_)
    starts[1:] = np.any(keys[1:] != keys[:-1], axis=1)
    first = np.maximum.accumulate(np.where(starts, np.arange(n), 0))
    starts |= (np.arange(n) - first) % _BLOCK == 0
    blocks: NDArray[np.intp] = np.cumsum(starts) - 1
    return blocks
