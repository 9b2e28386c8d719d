"""Time that passes only while this process runs.

Simulated boards keep their pace, and drivers lose their patience, by `time.monotonic`. On a machine that
stops a process for a second both jump, and a driver gives up on a board that had no chance to answer. Here
a thread looks at the clock every few milliseconds, and what passes between two looks counts for no more
than `_MOST_S`: a second in which nothing runs is no second. Who sleeps, or waits for a deadline by
`time.monotonic`, waits as much longer.

Import this before anything that takes hold of `time.monotonic`.
"""

import math
import os
import threading
import time

_LOOK_S = 0.005
_MOST_S = 0.03

_real_now, _real_sleep = time.monotonic, time.sleep


class SteadyTime:
    """Stands in for `time.monotonic` and `time.sleep`."""

    def __init__(self) -> None:
        self._most_s = _MOST_S
        now_s = _real_now()
        self._passed = (now_s, now_s)
        threading.Thread(target=self._run, name="steady-time", daemon=True).start()
        os.register_at_fork(after_in_child=self._run_free)

    def monotonic(self) -> float:
        passed_s, looked_s = self._passed
        return passed_s + min(_real_now() - looked_s, self._most_s)

    def sleep(self, seconds: float) -> None:
        if seconds <= 0.0:
            _real_sleep(seconds)
        ends_s = self.monotonic() + seconds
        while (left_s := ends_s - self.monotonic()) > 0.0:
            _real_sleep(left_s)

    def _run(self) -> None:
        while True:
            _real_sleep(_LOOK_S)
            passed_s, looked_s = self._passed
            now_s = _real_now()
            self._passed = (passed_s + min(now_s - looked_s, self._most_s), now_s)

    def _run_free(self) -> None:
        """A forked child has no thread that looks: there all time counts."""
        self._most_s = math.inf


_steady = SteadyTime()
time.monotonic, time.sleep = _steady.monotonic, _steady.sleep  # type: ignore[assignment]
