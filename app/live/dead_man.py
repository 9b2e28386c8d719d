"""Lasers that somebody lit by hand go off when nobody is there any more."""

import contextlib
import logging
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

from app.devices.bench import Bench
from app.errors import BenchBusy, DeviceError

DEAD_MAN_S = 30.0
_HOLDER = "the laser dead-man"
_log = logging.getLogger(__name__)


class DeadMan:
    """A thread that puts lasers out which burn unwatched; a job that holds the bench minds its own.

    Args:
        bench: whose lasers.
        seen_s: monotonic time at which anybody was there last.
        on_dark: told when it has put lasers out, with their names.
        limit_s: how long lasers may burn unwatched.
        period_s: how often it looks.
    """

    def __init__(
        self,
        bench: Bench,
        seen_s: Callable[[], float],
        on_dark: Callable[[tuple[str, ...]], None],
        limit_s: float = DEAD_MAN_S,
        period_s: float = 1.0,
    ) -> None:
        self._bench, self._seen_s, self._on_dark = bench, seen_s, on_dark
        self._limit_s, self._period_s = limit_s, period_s
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="laser dead-man", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._is_over.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._is_over.wait(self._period_s):
            try:
                self._look()
            except DeviceError as error:
                # It is tried again a period later, for as long as they are on.
                _log.warning("unwatched lasers cannot be put out: %s", error.message)
            except Exception:  # noqa: BLE001 (edge of a thread: it must look again)
                _log.exception("the laser dead-man failed")

    def _look(self) -> None:
        lit = self._bench.lasers_on
        if not lit or time.monotonic() - self._seen_s() <= self._limit_s:
            return
        # Taking the bench puts out what is lit, and giving it back makes it safe; a job that has it keeps it.
        with contextlib.suppress(BenchBusy), self._bench.lease(_HOLDER, wait_s=0.0):
            pass
        if not self._bench.lasers_on:
            self._on_dark(lit)
