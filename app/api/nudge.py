"""Wakes a coroutine from any thread, so that nobody who waits holds a thread."""

import asyncio
import threading


class Nudge:
    """For one coroutine that waits; made in the event loop in which it runs.

    Calling it never waits, and costs next to nothing while the last call has not been noticed yet. Once the
    loop is closed it raises RuntimeError.
    """

    def __init__(self) -> None:
        self._loop, self._event = asyncio.get_running_loop(), asyncio.Event()
        self._lock, self._is_told = threading.Lock(), False

    def __call__(self) -> None:
        with self._lock:
            if self._is_told:
                return
            self._is_told = True
        self._loop.call_soon_threadsafe(self._event.set)

    async def wait(self, timeout_s: float) -> bool:
        """Until the next call, or one since the last wait; False where none came in time."""
        try:
            async with asyncio.timeout(timeout_s):
                await self._event.wait()
        except TimeoutError:
            return False
        self._event.clear()
        with self._lock:
            self._is_told = False
        return True
