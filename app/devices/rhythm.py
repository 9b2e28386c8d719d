"""What the sequence of pictures tells about a camera: its rate, gaps, and pictures that came before."""

import statistics
from collections import deque
from collections.abc import Callable

import cv2
import numpy as np

from app.devices.camera_driver import Picture
from app.vision.stripe import Image

_MEMORY = 30
_LEAST = 5
# Noise moves every pixel of a real sensor, except where all of them are at one end of the scale.
_FEATURELESS_GREY = 2.0


class Rhythm:
    """When pictures were taken.

    Attributes:
        missing: pictures that should have come between others and did not; where the camera tells times.
    """

    def __init__(self) -> None:
        self.missing = 0
        self._before_s: float | None = None
        self._gaps_s: deque[float] = deque(maxlen=_MEMORY)

    @property
    def fps(self) -> float:
        """Pictures per second lately; 0 before there are enough."""
        if len(self._gaps_s) < _LEAST:
            return 0.0
        gap_s = statistics.median(self._gaps_s)
        return 1.0 / gap_s if gap_s > 0.0 else 0.0

    def add(self, exposed_s: float, is_timed: bool) -> None:
        if self._before_s is not None:
            gap_s = exposed_s - self._before_s
            if is_timed and self.fps:
                self.missing += max(0, round(gap_s * self.fps) - 1)
            self._gaps_s.append(gap_s)
        self._before_s = exposed_s

    def pause(self) -> None:
        """The camera was away; what did not come meanwhile is not missing."""
        self._before_s = None


class Repeats:
    """Tells a picture that is the one before once more, to the last bit.

    A picture that is given as a function is not looked at. One without any structure, as of a capped lens,
    may well come twice.
    """

    def __init__(self) -> None:
        self._before: Picture | None = None
        self._is_featureless = False

    def is_repeat(self, data: Picture | Callable[[], Picture]) -> bool:
        if callable(data):
            return False
        before, self._before = self._before, data
        if before is None or not _are_same(before, data):
            self._is_featureless = False
            return False
        self._is_featureless = self._is_featureless or _is_featureless(data)
        return not self._is_featureless


def _are_same(one: Picture, other: Picture) -> bool:
    if isinstance(one, bytes) or isinstance(other, bytes):
        return isinstance(one, bytes) and isinstance(other, bytes) and one == other
    return np.array_equal(one[:: max(1, len(one) // 8)], other[:: max(1, len(other) // 8)]) and (
        np.array_equal(one, other)
    )


def _is_featureless(data: Picture) -> bool:
    image: Image | None
    if isinstance(data, bytes):
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_REDUCED_GRAYSCALE_8)  # type: ignore[assignment]
        if image is None:
            return False
    else:
        image = data[::8, ::8]
    return float(image.std()) < _FEATURELESS_GREY
