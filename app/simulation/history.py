"""What was so, and since when."""

import threading
from collections import deque
from typing import Generic, TypeVar

T = TypeVar("T")


class History(Generic[T]):
    """A value that changes, remembered for some seconds. Safe from several threads.

    Args:
        first: the value until the first change.
        kept_s: for how long it can be asked what was so.
    """

    def __init__(self, first: T, kept_s: float) -> None:
        self._kept_s = kept_s
        self._lock = threading.Lock()
        self._values: deque[tuple[float, T]] = deque([(-float("inf"), first)])

    @property
    def last(self) -> T:
        """The value now."""
        return self._values[-1][1]

    def change(self, value: T, time_s: float) -> None:
        """From a time on it is this."""
        with self._lock:
            self._values.append((time_s, value))
            while self._values[1][0] < time_s - self._kept_s:
                self._values.popleft()

    def at(self, time_s: float) -> T:
        """The value at a time; at one before those that are remembered, the oldest."""
        with self._lock:
            known = [value for since_s, value in self._values if since_s <= time_s]
            return known[-1] if known else self._values[0][1]
