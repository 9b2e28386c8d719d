"""uvicorn as this server needs it: lasers go out with the first signal, a second one skips nothing."""

import asyncio
import contextlib
import logging
import os
import signal
import socket
import threading
from collections.abc import Callable, Iterator, Sequence
from types import FrameType

import uvicorn

from app.serving.notify import Notifier

# What is still being sent may take so long when the end comes.
_FAREWELL_S = 2
# When it has not ended by then it never will; the watchdog process puts lasers out if all else fails.
_PATIENCE_S = 30.0
_HURRY_S = 15.0
_SIGNS_OF_LIFE = 3.0
_log = logging.getLogger(__name__)


class Server(uvicorn.Server):
    """Serves until a signal comes.

    Args:
        config: of uvicorn.
        quieten: called in a thread of its own at the first signal: cancels jobs, puts lasers out.
        is_alive: asked in a thread, whether devices and jobs still do their work.
        notifier: told that it is ready, alive, ending.
        on_ready: called once requests are answered.
    """

    def __init__(
        self,
        config: uvicorn.Config,
        *,
        quieten: Callable[[], None],
        is_alive: Callable[[], bool],
        notifier: Notifier,
        on_ready: Callable[[], None],
    ) -> None:
        config.timeout_graceful_shutdown = _FAREWELL_S
        super().__init__(config)
        self._quieten, self._is_alive, self._notifier = quieten, is_alive, notifier
        self._on_ready = on_ready
        self._pulse: asyncio.Task[None] | None = None

    def run_until_told(self, sockets: list[socket.socket]) -> None:
        """Serve at these sockets; returns after a signal, when everything has ended.

        Raises:
            SystemExit: it could not start; the log says why.
        """
        with self._hearing_signals():
            self.run(sockets)

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """They are heard by `run_until_told`, from before the start until after the end."""
        yield

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """The first signal ends the server in order, the next one without waiting for anybody."""
        if self.should_exit:
            self.force_exit = True
            _end_after(_HURRY_S)
            return
        self.should_exit = True
        self._notifier.stopping()
        threading.Thread(target=self._quieten, name="quieten", daemon=True).start()
        _end_after(_PATIENCE_S)

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        if self.started:
            self._notifier.ready("Serving")
            self._on_ready()
            self._pulse = asyncio.create_task(self._beat())

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        if self._pulse is not None:
            self._pulse.cancel()
        # What is broken off now is no error.
        logging.getLogger("uvicorn.error").setLevel(logging.CRITICAL)
        await super().shutdown(sockets)
        if self.force_exit:
            # A second signal makes uvicorn skip this, and the bench would be left as it is.
            await self.lifespan.shutdown()

    async def _beat(self) -> None:
        """Tell the service manager that all is alive: sent by the event loop, after a look at the rest."""
        if not self._notifier.watchdog_s:
            return
        period_s = self._notifier.watchdog_s / _SIGNS_OF_LIFE
        was_alive = True
        while True:
            try:
                async with asyncio.timeout(self._notifier.watchdog_s):
                    is_alive = await asyncio.to_thread(self._is_alive)
            except TimeoutError:
                is_alive = False
            if is_alive:
                self._notifier.alive()
            elif was_alive:
                _log.error("the camera or a job does not answer any more; systemd is told nothing")
            was_alive = is_alive
            await asyncio.sleep(period_s)

    @contextlib.contextmanager
    def _hearing_signals(self) -> Iterator[None]:
        names: Sequence[str] = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
        with contextlib.ExitStack() as stack:
            for name in names:
                if hasattr(signal, name):
                    number = getattr(signal, name)
                    stack.callback(signal.signal, number, signal.signal(number, self.handle_exit))
            yield


def _end_after(seconds: float) -> None:
    """A last resort: leave the program as it is."""

    def end() -> None:
        _log.error("the server does not end by itself, and is left")
        os._exit(1)

    timer = threading.Timer(seconds, end)
    timer.daemon = True
    timer.start()
