"""The program's side of the watchdog: another process that makes the board safe when this one cannot."""

import contextlib
import json
import subprocess
import sys
import threading
from types import TracebackType
from typing import Any, Self

from app.devices.ports import resolve_port
from app.devices.turntable import Farewell

_BEAT_S = 0.25


class Watchdog:
    """Keeps the other process alive and told; safe from any thread, never fails.

    A system that cannot start it goes without: the drivers still end every orderly way out safely.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._is_over = threading.Event()
        self._beats: threading.Thread | None = None

    @property
    def is_running(self) -> bool:
        return self._process is not None and self._process.poll() is None

    def guard(self, farewell: Farewell | None) -> None:
        """From now on make this board safe when the program is gone; None for no board."""
        if farewell is None and self._process is None:
            return
        self._start()
        self._tell({"guard": None if farewell is None else farewell_facts(farewell)})

    def close(self) -> None:
        """The program leaves in good order."""
        self._is_over.set()
        if self._beats is not None:
            self._beats.join(timeout=2.0)
            self._beats = None
        self._tell({"leave": True})
        with self._lock:
            process, self._process = self._process, None
        if process is not None:
            if process.stdin is not None:
                with contextlib.suppress(OSError):
                    process.stdin.close()
            try:
                process.wait(timeout=5.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _start(self) -> None:
        with self._lock:
            if self._process is not None:
                return
            # Without -P, a folder called `app` where the program was started would be taken for ours.
            with contextlib.suppress(OSError):
                self._process = subprocess.Popen(
                    [sys.executable, "-P", "-m", "app.devices.watchdog_process"],
                    stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                    start_new_session=True, bufsize=0,
                )  # fmt: skip
        if self._process is None or self._beats is not None:
            return
        self._is_over.clear()
        self._beats = threading.Thread(target=self._beat, name="watchdog", daemon=True)
        self._beats.start()

    def _beat(self) -> None:
        while not self._is_over.wait(_BEAT_S):
            self._tell({})

    def _tell(self, message: dict[str, Any]) -> None:
        with self._lock:
            if self._process is not None and self._process.stdin is not None:
                with contextlib.suppress(OSError):
                    self._process.stdin.write(json.dumps(message).encode() + b"\n")


def farewell_facts(farewell: Farewell) -> dict[str, Any]:
    """A farewell as the other process takes it."""
    return {
        "port": resolve_port(farewell.port),
        "baud": farewell.baud,
        "stop_bits": farewell.stop_bits,
        "words": [(word.decode("latin-1"), wait_s) for word, wait_s in farewell.words],
    }
