"""The last picture without laser, for differences."""

import math
import threading

from app.devices.frame import Frame

# How long lasers must have been off before a picture counts as dark: cameras that do not tell when they
# exposed hand over what is some pictures old.
_SETTLED_S = 0.3


class DarkReference:
    """Keeps one frame, as the camera sent it until somebody looks. Any thread may use it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._dark_since_s = math.inf
        self._frame: Frame | None = None

    def note(self, frame: Frame, *, is_lit: bool) -> None:
        """A frame has come, and a laser is on now or none is."""
        with self._lock:
            if is_lit:
                self._dark_since_s = math.inf
                return
            self._dark_since_s = min(self._dark_since_s, frame.arrived_s)
            if frame.exposed_s - self._dark_since_s >= _SETTLED_S:
                self._frame = frame

    def partner(self, frame: Frame) -> Frame | None:
        """A dark frame of the same size and exposure, other than itself."""
        with self._lock:
            dark = self._frame
        if dark is None or dark is frame or dark.size != frame.size or dark.exposure_us != frame.exposure_us:
            return None
        return dark
