"""News, from whoever has them to whoever listens; a slow listener loses old news of a kind, never memory."""

import threading
from collections import OrderedDict, deque
from dataclasses import dataclass
from types import TracebackType
from typing import Self, TypeAlias

from app.jobs.job import JobSnapshot

_MOST_WAITING = 256


@dataclass(frozen=True, slots=True)
class JobChanged:
    """A job's snapshot is a new one."""

    job: JobSnapshot


@dataclass(frozen=True, slots=True)
class JobSaid:
    """A job has a line for its log."""

    job_id: str
    line: str


@dataclass(frozen=True, slots=True)
class PointsAdded:
    """A scan has more points."""

    job_id: str
    points: int


@dataclass(frozen=True, slots=True)
class BenchChanged:
    """Something about the bench is different: ask for its snapshot."""


Event: TypeAlias = JobChanged | JobSaid | PointsAdded | BenchChanged


class EventBus:
    """Hands every event to every listener; from any thread, without waiting."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._listeners: list[Listener] = []

    def publish(self, event: Event) -> None:
        with self._lock:
            listeners = tuple(self._listeners)
        for listener in listeners:
            listener.add(event)

    def listen(self) -> "Listener":
        """A new listener; it hears what is published from now on, until it is closed."""
        listener = Listener(self)
        with self._lock:
            self._listeners.append(listener)
        return listener

    def forget(self, listener: "Listener") -> None:
        with self._lock:
            self._listeners.remove(listener)


class Listener:
    """Events that wait for one reader. Of states only the newest waits; of log lines the last some hundred.

    Attributes:
        lost: log lines that were dropped because too many waited.
    """

    def __init__(self, bus: EventBus) -> None:
        self.lost = 0
        self._bus = bus
        self._changed = threading.Condition()
        self._states: OrderedDict[str, Event] = OrderedDict()
        self._lines: deque[JobSaid] = deque()
        self._is_closed = False

    def add(self, event: Event) -> None:
        with self._changed:
            if isinstance(event, JobSaid):
                self._lines.append(event)
                if len(self._lines) > _MOST_WAITING:
                    self._lines.popleft()
                    self.lost += 1
            else:
                self._states[_subject(event)] = event
            self._changed.notify_all()

    def next(self, timeout_s: float) -> Event | None:
        """The next event; None when there was none in time, or the listener is closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._states or self._lines or self._is_closed, timeout_s)
            if self._lines:
                return self._lines.popleft()
            return self._states.popitem(last=False)[1] if self._states else None

    def close(self) -> None:
        with self._changed:
            if self._is_closed:
                return
            self._is_closed = True
            self._changed.notify_all()
        self._bus.forget(self)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _subject(event: Event) -> str:
    """Two events of one subject: the newer says it all."""
    if isinstance(event, JobChanged):
        return f"job {event.job.id}"
    return f"points {event.job_id}" if isinstance(event, PointsAdded) else "bench"
