"""A source of pictures whose reads block for as long as they like, kept by a thread of its own.

The thread alone touches the source: it opens and reads it, does what others ask between two reads, and
closes it, even when everybody else has long given up waiting.
"""

import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeout
from dataclasses import replace
from typing import Any, Generic, Protocol, TypeVar

from app.devices.camera_driver import RawFrame
from app.errors import DeviceError, DeviceLost, DeviceTimeout

# Enough for a reader that is held up a little; who is held up longer wants the newest.
_MOST = 8
_CLOSE_S = 1.0
_ASK_S = 3.0

T = TypeVar("T")


class BlockingSource(Protocol):
    """Pictures from something that has no timeouts worth the name."""

    def read(self) -> RawFrame | None:
        """The next picture; None where there was none, and another try is worth while.

        Raises:
            DeviceError: no further one will come.
        """
        ...

    def interrupt(self) -> None:
        """From another thread: a read that waits should give up, where that can be done."""
        ...

    def close(self) -> None: ...


S = TypeVar("S", bound=BlockingSource)


class ReadingThread(Generic[S]):
    """Opens a source and reads ahead.

    Args:
        device: what messages call it.
        open_source: opens the source, in the thread.
        timeout_s: how long opening may take.

    Raises:
        DeviceError: whatever opening raised.
        DeviceTimeout: it took too long.
    """

    def __init__(self, device: str, open_source: Callable[[], S], timeout_s: float) -> None:
        self._device, self._open_source = device, open_source
        self._frames: deque[RawFrame] = deque(maxlen=_MOST)
        self._jobs: deque[tuple[Callable[[S], Any], Future[Any]]] = deque()
        self._changed = threading.Condition()
        self._source: S | None = None
        self._is_closing = False
        self._error: DeviceError | None = None
        self._thread = threading.Thread(target=self._run, name=f"{device}-read", daemon=True)
        self._thread.start()
        with self._changed:
            if not self._changed.wait_for(self._has_answer, timeout_s):
                self._is_closing = True
                raise DeviceTimeout(device, "open", timeout_s)
            if self._source is None and self._error is not None:
                raise self._error

    def grab(self, timeout_s: float) -> RawFrame:
        """The next picture; one that is late comes out of a later call."""
        deadline_s = time.monotonic() + timeout_s
        with self._changed:
            while not self._frames:
                if self._error is not None:
                    raise self._error
                if self._is_closing:
                    raise DeviceLost(self._device, "has been let go")
                left_s = deadline_s - time.monotonic()
                if left_s <= 0.0:
                    raise DeviceTimeout(self._device, "a picture", timeout_s)
                self._changed.wait(left_s)
            return self._frames.popleft()

    def ask(self, work: Callable[[S], T], timeout_s: float = _ASK_S) -> T:
        """Have something done with the source between two reads."""
        future: Future[T] = Future()
        with self._changed:
            if self._error is not None:
                raise self._error
            self._jobs.append((work, future))
        try:
            return future.result(timeout_s)
        except FutureTimeout:
            future.cancel()
            raise DeviceTimeout(self._device, "a control", timeout_s) from None

    def close(self) -> None:
        """Have the source closed; a read that hangs is not waited for long."""
        with self._changed:
            self._is_closing = True
            self._frames.clear()
            self._changed.notify_all()
            if self._source is not None:
                self._source.interrupt()
        self._thread.join(_CLOSE_S)

    def _has_answer(self) -> bool:
        return self._source is not None or self._error is not None

    def _run(self) -> None:
        try:
            source = self._open_source()
        except DeviceError as error:
            self._end(error)
            return
        except Exception as error:  # noqa: BLE001 (edge of a thread)
            self._end(DeviceError(self._device, f"cannot be opened ({error!r})"))
            return
        try:
            with self._changed:
                self._source = source
                self._changed.notify_all()
            while not self._is_closing:
                self._do_jobs(source)
                frame = source.read()
                if frame is not None:
                    with self._changed:
                        self._frames.append(_stamped(frame))
                        self._changed.notify_all()
            self._end(DeviceLost(self._device, "has been let go"))
        except DeviceError as error:
            self._end(error)
        except Exception as error:  # noqa: BLE001 (edge of a thread)
            self._end(DeviceLost(self._device, f"its driver failed ({error!r})"))
        finally:
            with self._changed:
                self._source = None
            source.close()

    def _do_jobs(self, source: S) -> None:
        while self._jobs:
            work, future = self._jobs.popleft()
            if not future.set_running_or_notify_cancel():
                continue
            try:
                future.set_result(work(source))
            except DeviceError as error:
                future.set_exception(error)

    def _end(self, error: DeviceError) -> None:
        with self._changed:
            self._error = error
            for _, future in self._jobs:
                if future.set_running_or_notify_cancel():
                    future.set_exception(error)
            self._jobs.clear()
            self._changed.notify_all()


def _stamped(frame: RawFrame) -> RawFrame:
    return replace(frame, arrived_s=time.monotonic()) if frame.arrived_s is None else frame
