"""A thread that looks after a board while nobody talks to it."""

import contextlib
import threading
from collections.abc import Callable

from app.devices.serial_link import SerialLink
from app.errors import DeviceError

_JOIN_S = 5.0


class IdleWatch:
    """Does something again and again, in a dialogue of its own; never when another thread has one.

    Attributes:
        name: of the thread.
    """

    def __init__(self, link: SerialLink, name: str, period_s: float, action: Callable[[], None]) -> None:
        self._link, self.name, self._period_s, self._action = link, name, period_s, action
        self._is_over = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        if self._thread is None:
            self._is_over.clear()
            self._thread = threading.Thread(target=self._run, name=self.name, daemon=True)
            self._thread.start()

    def stop(self) -> None:
        self._is_over.set()
        thread, self._thread = self._thread, None
        if thread is not None and thread is not threading.current_thread():
            thread.join(timeout=_JOIN_S)

    def _run(self) -> None:
        while not self._is_over.wait(self._period_s):
            with contextlib.suppress(DeviceError), self._link.dialogue(wait_s=0.0):
                self._action()
