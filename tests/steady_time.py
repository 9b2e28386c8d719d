"""Time that passes only while this process runs.

Simulated boards keep their pace, and drivers lose their patience, by `time.monotonic`. On a machine that
stops a process for a second both jump, and a driver gives up on a board that had no chance to answer. Here
a thread looks at the clock every few milliseconds, and of what passes between two looks hardly more counts
than `_MOST_S`: a second in which nothing runs is no second. Who sleeps, or waits for something until a
deadline, waits as much longer.

Import this before anything that takes hold of `time.monotonic`.
"""

import os
import threading
import time

_LOOK_S = 0.005
_MOST_S = 0.03
# Two times are never the same.
_BEYOND = 1e-3

_real_now, _real_sleep, _real_wait = time.monotonic, time.sleep, threading.Condition.wait


class SteadyTime:
    """Stands in for `time.monotonic`, `time.sleep` and whatever waits by a `threading.Condition`."""

    def __init__(self) -> None:
        self._is_free = False
        now_s = _real_now()
        self._passed = (now_s, now_s)
        threading.Thread(target=self._run, name="steady-time", daemon=True).start()
        os.register_at_fork(after_in_child=self._run_free)

    def monotonic(self) -> float:
        return self._look()[0]

    def sleep(self, seconds: float) -> None:
        if seconds <= 0.0:
            _real_sleep(seconds)
        ends_s = self.monotonic() + seconds
        while (left_s := ends_s - self.monotonic()) > 0.0:
            _real_sleep(left_s)

    def wait(self, condition: threading.Condition, timeout: float | None = None) -> bool:
        if timeout is None or timeout <= 0.0:
            return _real_wait(condition, timeout)
        ends_s = self.monotonic() + timeout
        while (left_s := ends_s - self.monotonic()) > 0.0:
            if _real_wait(condition, left_s):
                return True
        return False

    def _look(self) -> tuple[float, float]:
        """How much time has passed, and the real one."""
        passed_s, looked_s = self._passed
        now_s = _real_now()
        gone_s = now_s - looked_s
        if not self._is_free:
            gone_s = min(gone_s, _MOST_S + _BEYOND * gone_s)
        return passed_s + gone_s, now_s

    def _run(self) -> None:
        while True:
            _real_sleep(_LOOK_S)
            self._passed = self._look()

    def _run_free(self) -> None:
        """A forked child has no thread that looks: there all time counts."""
        self._is_free = True


def _wait(condition: threading.Condition, timeout: float | None = None) -> bool:
    return _steady.wait(condition, timeout)


_steady = SteadyTime()
time.monotonic, time.sleep = _steady.monotonic, _steady.sleep  # type: ignore[assignment]
threading.Condition.wait = _wait  # type: ignore[method-assign, assignment]
