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
        self._seen = 0

    def add(self, rows: NDArray[np.float32]) -> None:
        """Rows (N, columns)."""
        chosen = self._chosen(rows)
        while self._count + len(chosen) > self.limit:
            kept = self._rows[: self._count : 2].copy()
            self._rows[: len(kept)] = kept
            self._count = len(kept)
            self._stride *= 2
            chosen = self._chosen(rows)
        self._rows[self._count : self._count + len(chosen)] = chosen
        self._count += len(chosen)
        self._seen += len(rows)

    def _chosen(self, rows: NDArray[np.float32]) -> NDArray[np.float32]:
        return rows[-self._seen % self._stride :: self._stride]

    @property
    def rows(self) -> NDArray[np.float32]:
        """(M, columns), M at most `limit`."""
        return self._rows[: self._count]
