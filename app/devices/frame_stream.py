"""Every frame of a camera for one reader, in order and none left out while it keeps up."""

import threading
import time
from collections import deque
from collections.abc import Iterator

from app.devices.frame import Frame
from app.errors import DeviceLost


class FrameStream:
    """Frames that wait for their reader; made by `Camera.stream`.

    Iterating waits for the next frame and ends with `end`, once the frames that wait are read. Across a
    camera that is away and comes back it goes on, unless it takes longer than the reader is patient.

    Attributes:
        lost: frames that were dropped because too many waited.
    """

    def __init__(self, name: str, most: int, patience_s: float | None) -> None:
        self.lost = 0
        self._name, self._most, self._patience_s = name, most, patience_s
        self._frames: deque[Frame] = deque()
        self._changed = threading.Condition()
        self._lost_since_s: float | None = None
        self._error = ""
        self._has_ended = False

    def __iter__(self) -> Iterator[Frame]:
        return self

    def __len__(self) -> int:
        """How many frames wait."""
        return len(self._frames)

    def __next__(self) -> Frame:
        with self._changed:
            while not self._frames:
                if self._has_ended:
                    raise StopIteration
                self._changed.wait(self._wait_s())
            return self._frames.popleft()

    def add(self, frame: Frame) -> None:
        with self._changed:
            if self._has_ended:
                return
            if len(self._frames) >= self._most:
                self._frames.popleft()
                self.lost += 1
            self._frames.append(frame)
            self._changed.notify_all()

    def lose(self, error: str) -> None:
        """The camera has gone."""
        with self._changed:
            self._lost_since_s, self._error = time.monotonic(), error
            self._changed.notify_all()

    def find(self) -> None:
        """The camera is back."""
        with self._changed:
            self._lost_since_s = None

    def end(self) -> None:
        """No more frames; from any thread."""
        with self._changed:
            self._has_ended = True
            self._changed.notify_all()

    def _wait_s(self) -> float | None:
        """How long a reader may still wait for a camera that is away."""
        if self._patience_s is None or self._lost_since_s is None:
            return None
        left_s = self._lost_since_s + self._patience_s - time.monotonic()
        if left_s <= 0.0:
            raise DeviceLost(self._name, f"has gone ({self._error})")
        return left_s
