"""How long a job will go on, foretold from what was expected and from how fast it goes."""

from collections import deque

# So much of the work must be done before what was expected counts no more.
_SETTLED = 0.15
# The pace is that of the last half minute, or of the last part of the work where that is more.
_WINDOW_S = 30.0
_WINDOW = 0.1


class Pace:
    """Told how far a job is; rests and waits are left out of the time that it is told.

    Work that begins again at a smaller number is another part of the job, of which nothing was expected.

    Args:
        expected_s: how long the first part was expected to take as a whole; None where nobody knows.
    """

    def __init__(self, expected_s: float | None = None) -> None:
        self._expected_s = expected_s
        self._total = 0
        self._known: deque[tuple[float, int]] = deque()
        self._began = 0

    def left_s(self, active_s: float, done: int, total: int) -> float | None:
        """Seconds to the end of this part of the work; None while that cannot be told.

        Args:
            active_s: how long the job has worked so far.
            done, total: of this part.
        """
        if total <= 0:
            return None
        if self._known and (total != self._total or done < self._known[-1][1]):
            self._known.clear()
            self._expected_s = None
        if not self._known:
            self._began = done
        self._total = total
        self._known.append((active_s, done))
        self._forget(active_s, total)
        expected = None if self._expected_s is None else self._expected_s * (1.0 - done / total)
        measured = self._measured(total - done)
        if measured is None or expected is None:
            return expected if measured is None else measured
        weight = min(1.0, (done - self._began) / (_SETTLED * total))
        return weight * measured + (1.0 - weight) * expected

    def _measured(self, left: int) -> float | None:
        (from_s, from_done), (to_s, to_done) = self._known[0], self._known[-1]
        return None if to_done <= from_done else left * (to_s - from_s) / (to_done - from_done)

    def _forget(self, active_s: float, total: int) -> None:
        newest = self._known[-1][1]
        while len(self._known) > 2:
            next_s, next_done = self._known[1]
            if active_s - next_s < _WINDOW_S or newest - next_done < _WINDOW * total:
                return
            self._known.popleft()
