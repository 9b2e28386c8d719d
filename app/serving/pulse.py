"""Whether the threads that a server needs still do their work."""

import time
from collections.abc import Callable

from app.devices.camera import CameraState

# A camera that stays silent is closed and opened again within seconds; where not even that happens, its
# thread hangs.
_HANGS_S = 30.0


class Pulse:
    """Looks at the camera's thread and at the jobs.

    Args:
        camera: asks how the camera is.
        jobs: asks for the jobs, and with that for the lock that they all need.
        now_s: monotonic.
    """

    def __init__(
        self,
        camera: Callable[[], CameraState],
        jobs: Callable[[], object],
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._camera, self._jobs, self._now_s = camera, jobs, now_s
        self._silent_since_s: float | None = None

    def beats(self) -> bool:
        """Whether all is alive; does not return where a lock is held for ever."""
        self._jobs()
        state = self._camera()
        now_s = self._now_s()
        if not (state.is_connected and state.is_frozen):
            self._silent_since_s = None
            return True
        if self._silent_since_s is None:
            self._silent_since_s = now_s
        return now_s - self._silent_since_s < _HANGS_S
