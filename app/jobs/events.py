"""News, from whoever has them to whoever listens; a slow listener loses old news of a kind, never memory."""

import threading
from collections import OrderedDict, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import TracebackType
from typing import Self, TypeAlias

from app.jobs.calibrate_state import CalibrationState
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


@dataclass(frozen=True, slots=True)
class Notice:
    """Something that people should be told, whatever they are doing.

    Attributes:
        text: one sentence.
        hint: what to do; empty where nothing is to be done.
    """

    text: str
    hint: str = ""


@dataclass(frozen=True, slots=True)
class Counters:
    """What is counted while somebody listens.

    Attributes:
        frames, lost: pictures of the camera, and those that did not come.
        fps: pictures per second lately.
        points: of the scan that runs or ran last.
        viewers: of live pictures, by kind; of the 3D view as `cloud`, of events as `events`.
        live_fps: live pictures made per second, by kind.
        skipped: frames that present viewers were not shown.
        bytes_sent: by the server since its start.
    """

    frames: int = 0
    lost: int = 0
    fps: float = 0.0
    points: int = 0
    viewers: Mapping[str, int] = field(default_factory=dict)
    live_fps: Mapping[str, float] = field(default_factory=dict)
    skipped: int = 0
    bytes_sent: int = 0


@dataclass(frozen=True, slots=True)
class CalibrationChanged:
    """A calibration that is being made stands differently."""

    calibration: CalibrationState


Event: TypeAlias = CalibrationChanged | JobChanged | JobSaid | PointsAdded | BenchChanged | Notice | Counters


class EventBus:
    """Hands every event to every listener; from any thread, without waiting.

    Attributes:
        points: of the scan that runs or ran last.
    """

    def __init__(self) -> None:
        self.points = 0
        self._lock = threading.Lock()
        self._listeners: list[Listener] = []

    @property
    def listeners(self) -> int:
        """How many listen."""
        return len(self._listeners)

    def publish(self, event: Event) -> None:
        if isinstance(event, PointsAdded):
            self.points = event.points
        with self._lock:
            listeners = tuple(self._listeners)
        for listener in listeners:
            listener.add(event)

    def listen(self, on_ready: Callable[[], None] | None = None) -> "Listener":
        """A new listener; it hears what is published from now on, until it is closed.

        Args:
            on_ready: told, from whatever thread, that an event waits; must not wait for anything. A listener
                whose callback raises is closed.
        """
        listener = Listener(self, on_ready)
        with self._lock:
            self._listeners.append(listener)
        return listener

    def forget(self, listener: "Listener") -> None:
        with self._lock:
            self._listeners.remove(listener)


class Listener:
    """Events that wait for one reader. Of states the newest waits; of lines and notices the last few hundred.

    Attributes:
        lost: lines that were dropped because too many waited.
    """

    def __init__(self, bus: EventBus, on_ready: Callable[[], None] | None = None) -> None:
        self.lost = 0
        self._bus, self._on_ready = bus, on_ready
        self._changed = threading.Condition()
        self._states: OrderedDict[str, Event] = OrderedDict()
        self._lines: deque[JobSaid | Notice] = deque()
        self._is_closed = False

    def add(self, event: Event) -> None:
        with self._changed:
            if isinstance(event, JobSaid | Notice):
                self._lines.append(event)
                if len(self._lines) > _MOST_WAITING:
                    self._lines.popleft()
                    self.lost += 1
            else:
                self._states[_subject(event)] = event
            self._changed.notify_all()
        if self._on_ready is not None:
            try:
                self._on_ready()
            except Exception:  # noqa: BLE001 (whoever cannot be told any more has gone; the others have not)
                self.close()

    def take(self) -> list[Event]:
        """Everything that waits, lines first; never waits."""
        with self._changed:
            waiting: list[Event] = [*self._lines, *self._states.values()]
            self._lines.clear()
            self._states.clear()
            return waiting

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
    if isinstance(event, PointsAdded):
        return f"points {event.job_id}"
    if isinstance(event, CalibrationChanged):
        return f"calibration {event.calibration.job_id}"
    return "counters" if isinstance(event, Counters) else "bench"
