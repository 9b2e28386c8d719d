"""Follows a camera while somebody looks, wherever the camera goes in the meantime."""

import threading
from collections.abc import Callable

from app.devices.camera import Camera
from app.devices.frame import Frame
from app.devices.frame_stream import FrameStream
from app.errors import DeviceError

# A camera that is gone for less is not worth a word.
_PATIENCE_S = 0.4
_RETRY_S = 0.25


class Feed:
    """A thread that hands over each frame as it comes. It ends with `stop`.

    Args:
        camera: need not be connected, and may go and come back.
        on_frame: told the newest frame; frames that come while it is busy are left out.
        on_lost: told, once for each reason, why there are none.
    """

    def __init__(
        self, camera: Camera, on_frame: Callable[[Frame], None], on_lost: Callable[[str], None]
    ) -> None:
        self._camera, self._on_frame, self._on_lost = camera, on_frame, on_lost
        self._stopped = threading.Event()
        self._lock = threading.Lock()
        self._stream: FrameStream | None = None
        self._told = ""
        self._thread = threading.Thread(target=self._run, name="live frames", daemon=True)
        self._thread.start()

    @property
    def is_stopped(self) -> bool:
        return self._stopped.is_set()

    def stop(self) -> None:
        """No more frames; returns at once."""
        with self._lock:
            self._stopped.set()
            if self._stream is not None:
                self._stream.end()

    def join(self) -> None:
        """Wait for the thread; not from within it."""
        self._thread.join()

    def rest(self, seconds: float) -> None:
        """Wait, but not beyond `stop`."""
        self._stopped.wait(seconds)

    def _run(self) -> None:
        while not self.is_stopped:
            try:
                self._follow()
            except DeviceError as error:
                self._tell(error.message)
            except Exception as error:  # noqa: BLE001 (edge of a thread: whoever looks is told, and it goes on)
                self._tell(f"Live pictures are interrupted ({error!r}).")
            self.rest(_RETRY_S)

    def _follow(self) -> None:
        with self._camera.stream(most=1, patience_s=_PATIENCE_S) as stream:
            with self._lock:
                if self.is_stopped:
                    return
                self._stream = stream
            for frame in stream:
                self._told = ""
                self._on_frame(frame)

    def _tell(self, problem: str) -> None:
        if problem != self._told and not self.is_stopped:
            self._told = problem
            self._on_lost(problem)
