"""An even choice from a stream of unknown length, in bounded memory."""

import numpy as np
from numpy.typing import NDArray


class Sample:
    """Every k-th row of what was added; k doubles whenever there are too many.

    Args:
        columns: width of a row.
        limit: rows that are kept at most.
    """

    def __init__(self, columns: int, limit: int) -> None:
        self.limit = limit
        self._rows = np.empty((limit, columns), np.float32)
        self._count = 0
        self._stride = 1
        self._phase = 0

    def add(self, rows: NDArray[np.float32]) -> None:
        """Rows (N, columns)."""
        chosen = rows[self._phase :: self._stride]
        self._phase = (self._phase - len(rows)) % self._stride
        while self._count + len(chosen) > self.limit:
            kept = self._rows[: self._count : 2].copy()
            self._rows[: len(kept)] = kept
            chosen = chosen[self._count % 2 :: 2]
            self._count = len(kept)
            self._stride *= 2
            self._phase = 0
        self._rows[self._count : self._count + len(chosen)] = chosen
        self._count += len(chosen)

    @property
    def rows(self) -> NDArray[np.float32]:
        """(M, columns), M at most `limit`."""
        return self._rows[: self._count]
