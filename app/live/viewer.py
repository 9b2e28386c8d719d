"""One who looks, and the one picture that waits for them."""

import threading
import weakref
from collections.abc import Callable
from types import TracebackType
from typing import TYPE_CHECKING, Self

from app.live.develop import Flavour
from app.live.picture import LivePicture

if TYPE_CHECKING:
    from app.live.pictures import LivePictures


class Seat:
    """What `LivePictures` keeps of a viewer; only that may change it, under its lock.

    Attributes:
        flavour: what is shown.
        on_ready: told, in whatever thread, that a picture waits.
        wants: whether a newer picture is asked for.
        had: number of the view that was handed over last.
        had_frame: number of its frame.
        box: the one that waits to be taken.
        skipped: frames that came between those that were shown.
        is_gone: whether nobody looks any more.
        ready: set while one waits.
    """

    def __init__(self, flavour: Flavour, on_ready: Callable[[], None] | None) -> None:
        self.flavour, self.on_ready = flavour, on_ready
        self.wants = self.is_gone = False
        self.had = self.had_frame = self.skipped = 0
        self.box: LivePicture | None = None
        self.ready = threading.Event()

    def leave(self) -> None:
        """May be called while anything is locked, so it only says so."""
        self.is_gone = True


class LiveViewer:
    """Gets the newest picture each time it asks, and misses what came while it did not ask.

    Either call `next`, which waits; or give `watch` a callback, call `acknowledge` whenever the page is ready
    for a picture, and `take` it when the callback says that it is there. Whoever does not ask costs nothing.
    A viewer that is dropped without `close` is forgotten when Python frees it.
    """

    def __init__(self, pictures: "LivePictures", seat: Seat) -> None:
        self._pictures, self._seat = pictures, seat
        self._leave = weakref.finalize(self, seat.leave)
        self._leave.atexit = False

    @property
    def skipped(self) -> int:
        """Frames that were not shown because this viewer was busy, or the machine was."""
        return self._seat.skipped

    @property
    def is_open(self) -> bool:
        """Whether pictures may still come."""
        return not self._seat.is_gone

    def next(self, timeout_s: float) -> LivePicture | None:
        """The newest picture that this viewer has not had; None where none came in time, or it is closed."""
        return self._pictures.next_for(self._seat, timeout_s)

    def acknowledge(self) -> None:
        """The last picture is shown; another is wanted. Never waits."""
        self._pictures.ask_for(self._seat)

    def take(self) -> LivePicture | None:
        """The picture that waits; None for none. Never waits."""
        return self._pictures.take_for(self._seat)

    def close(self) -> None:
        """Nobody looks any more. A `next` in another thread returns."""
        self._leave()
        self._seat.ready.set()
        self._pictures.forget_those_gone()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
