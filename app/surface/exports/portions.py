"""Long tables, written part by part."""

from collections.abc import Iterator
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Kind = TypeVar("Kind", bound=np.generic)
AT_ONCE = 65_536


def portions(rows: NDArray[Kind]) -> Iterator[NDArray[Kind]]:
    """So many rows at a time that their text fits into memory easily."""
    for first in range(0, len(rows), AT_ONCE):
        yield rows[first : first + AT_ONCE]
