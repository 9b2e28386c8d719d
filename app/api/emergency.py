"""The emergency stop: works while everything else hangs, because it waits for nothing and nobody."""

import asyncio
import contextlib
import threading
from collections.abc import Callable

from app.devices.bench import Bench
from app.errors import DeviceError, DeviceTimeout

# By then every board that can be stopped has stopped.
_PATIENCE_S = 5.0


class EmergencyStop:
    """Stops the bench in a thread of its own, each time it is pressed.

    Args:
        bench: to be stopped.
        cancel_jobs: ends the jobs that use the bench; may take its time.
        on_change: told when the bench has been stopped.
    """

    def __init__(self, bench: Bench, cancel_jobs: Callable[[], None], on_change: Callable[[], None]) -> None:
        self._bench, self._cancel_jobs, self._on_change = bench, cancel_jobs, on_change

    async def press(self, patience_s: float = _PATIENCE_S) -> None:
        """Lasers off, table stopped, whoever holds the bench; its job ends as cancelled.

        Raises:
            DeviceTimeout: the board has not done it yet; it goes on trying.
            DeviceError: the board cannot be reached.
        """
        loop = asyncio.get_running_loop()
        outcome: asyncio.Future[DeviceError | None] = loop.create_future()

        def tell(error: DeviceError | None) -> None:
            if not outcome.done():
                outcome.set_result(error)

        def stop() -> None:
            error: DeviceError | None = None
            try:
                self._bench.halt()
            except DeviceError as refused:
                error = refused
            except Exception as broken:  # noqa: BLE001 (edge of a thread: whoever pressed must be told)
                error = DeviceError("emergency stop", f"the driver failed ({broken!r})", _UNPLUG)
            self._on_change()
            with contextlib.suppress(RuntimeError):
                loop.call_soon_threadsafe(tell, error)

        for name, work in (("emergency stop", stop), ("emergency cancel", self._cancel_jobs)):
            threading.Thread(target=work, name=name, daemon=True).start()
        try:
            async with asyncio.timeout(patience_s):
                error = await outcome
        except TimeoutError as late:
            raise DeviceTimeout("emergency stop", "stop", patience_s, _UNPLUG) from late
        if error is not None:
            raise error


_UNPLUG = "Switch off the power of the board and the lasers."
