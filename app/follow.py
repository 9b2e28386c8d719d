"""Shows in the 3D view what the bench does: the table's angle, the lasers, what the camera sees."""

import math
import threading
from types import TracebackType
from typing import Self

from app.devices.bench import Bench
from app.errors import DeviceError
from app.viewer.cloud_view import CloudView
from app.vision.stripe import Image

_PERIOD_S = 0.2


class Follower:
    """A thread that looks at the bench five times a second, while somebody watches."""

    def __init__(self, bench: Bench, view: CloudView) -> None:
        self._bench, self._view = bench, view
        self._is_over = threading.Event()
        self._shown = -1
        self._thread = threading.Thread(target=self._run, name="follower", daemon=True)

    def __enter__(self) -> Self:
        self._view.show_pictures(self._picture)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._is_over.set()
        self._thread.join()
        self._view.show_pictures(None)

    def _run(self) -> None:
        while not self._is_over.wait(_PERIOD_S):
            if self._view.viewers:
                snapshot = self._bench.snapshot()
                # Another bench may have been chosen.
                way = math.radians(1.0 if self._bench.description.turntable.direction == "ccw" else -1.0)
                self._view.turn_to(way * snapshot.angle_deg)
                self._view.light(snapshot.lasers_on)

    def _picture(self) -> Image | None:
        """The newest one that was not shown yet."""
        frame = self._bench.camera.latest()
        if frame is None or frame.index == self._shown:
            return None
        self._shown = frame.index
        try:
            return frame.image()
        except DeviceError:
            return None
