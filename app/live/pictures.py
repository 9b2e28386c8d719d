"""Live pictures for any number of viewers: the newest frame for each, made once, while somebody looks."""

import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Self

from app.devices.bench import Bench
from app.devices.camera import Camera
from app.devices.frame import Frame
from app.errors import DeviceError, OptionError
from app.geometry.rig import Rig
from app.live.darkroom import Darkroom, View
from app.live.develop import Flavour
from app.live.feed import Feed
from app.live.known import Known
from app.live.meter import LiveState
from app.live.picture import LivePicture
from app.live.settings import Kind, LiveSettings, usual_width
from app.live.viewer import LiveViewer, Seat

# Of one processor: what making pictures may take. After each there is a pause that keeps to it.
_SHARE = 0.3
_TICK_S = 0.5
# Pictures per second that are made here; more do not show more of a table that turns, and cost as much again.
_MOST_FPS = 15.0
_LONGEST_REST_S = 1.0


class LivePictures:
    """Every method may be called from any thread; none waits for the camera or for a viewer but `next`.

    Threads run while there are viewers, and a picture is made when somebody has asked for it: once per frame
    and flavour, however many look. What viewers do not fetch is dropped, one picture each at most is kept.
    Making takes no more than a share of one processor: on a slow machine viewers get fewer pictures, and
    the measurement its due.

    While the camera is away each viewer is shown once, and every newcomer, that no picture comes: see
    `nothing_new`. When it is back, pictures go on by themselves.

    Args:
        camera: may be connected later, and may go and come back.
        known: of the scanner.
        lit: tells which lasers are on.
        settings: to begin with.
        share: of one processor, 0..1.
        most_fps: of pictures that have to be made; the camera's own are passed on as they come.
    """

    def __init__(
        self,
        camera: Camera,
        known: Known | None = None,
        *,
        lit: Callable[[], Sequence[str]] = tuple,
        settings: LiveSettings | None = None,
        share: float = _SHARE,
        most_fps: float = _MOST_FPS,
    ) -> None:
        self._camera, self._lit, self._share = camera, lit, share
        self._known, self._settings = known or Known(), settings or LiveSettings()
        self._changed = threading.Condition()
        self._seats: list[Seat] = []
        self._ready: dict[Flavour, tuple[int, LivePicture]] = {}
        self._view: View | None = None
        self._number = 0
        self._feed: Feed | None = None
        self._worker: threading.Thread | None = None
        self._is_closed = False
        self._darkroom = Darkroom(camera)
        self._rest_s, self._next_s = 1.0 / most_fps, 0.0

    @classmethod
    def of_bench(cls, bench: Bench, rig: Rig | None = None) -> Self:
        """Of a bench's camera and lasers, with the board and markers of its file."""
        description = bench.description
        known = Known(
            {name: entry.colour for name, entry in bench.lasers.items()},
            rig,
            board=None if description.board is None else description.board.spec(),
            platter=None if description.platter is None else description.platter.spec(),
        )
        return cls(bench.camera, known, lit=lambda: bench.snapshot().lasers_on)

    def look_through(self, bench: Bench) -> None:
        """Show another camera, and forget what was known of the scanner; viewers stay."""
        fresh = type(self).of_bench(bench)
        with self._changed:
            self._camera, self._known = fresh._camera, fresh._known
            self._darkroom.look_through(fresh._camera)
            self._settings = replace(self._settings, laser=None, polygon=())
            if self._feed is not None:
                self._feed.stop()
                self._begin()

    @property
    def settings(self) -> LiveSettings:
        return self._settings

    @property
    def known(self) -> Known:
        """What is known of the scanner."""
        return self._known

    def change(self, **changes: Any) -> LiveSettings:
        """Other settings, from the next picture on.

        Raises:
            OptionError: naming the setting; nothing is changed then.
        """
        with self._changed:
            self._settings = self._settings.changed(tuple(self._known.colours), **changes)
            return self._settings

    def learn(self, **news: Any) -> None:
        """Another calibration, board or limits, by the names of the attributes of `Known`."""
        with self._changed:
            self._known = replace(self._known, **news)
            self._darkroom.search.forget()

    def watch(
        self,
        kind: Kind,
        *,
        width: int | None = None,
        is_packed: bool = False,
        is_captioned: bool = True,
        on_ready: Callable[[], None] | None = None,
    ) -> LiveViewer:
        """A new viewer, to be closed by whoever asked for it.

        Args:
            kind: what it sees.
            width: columns of its pictures at most, rounded up to a usual number; None for the settings'.
            is_packed: a mask as bits for a page that draws it, not as JPEG.
            is_captioned: whether words are written into pictures; a page says them in its own language.
            on_ready: told, from whatever thread, that a picture waits; must not wait for anything. A viewer
                whose callback raises is forgotten.

        Raises:
            OptionError: no such width, or something other than a mask as bits.
        """
        if is_packed and kind is not Kind.MASK:
            raise OptionError(f"is_packed: only a mask can be had as bits, not {kind}.", "Leave it out.")
        seat = Seat(Flavour(kind, usual_width("width", width), is_packed, is_captioned), on_ready)
        with self._changed:
            if self._is_closed:
                seat.leave()
            else:
                self._seats.append(seat)
                if self._feed is None:
                    self._begin()
        return LiveViewer(self, seat)

    @property
    def state(self) -> LiveState:
        meter = self._darkroom.meter
        with self._changed:
            there = [seat for seat in self._seats if not seat.is_gone]
            viewers = Counter(seat.flavour.kind for seat in there)
            return LiveState(
                {kind: viewers[kind] for kind in Kind}, meter.fps(), meter.ms(),
                meter.made_of.total(), {kind: meter.made_of[kind] for kind in Kind},
                sum(seat.skipped for seat in there), self._feed is not None,
                "" if self._view is None else self._view.problem,
            )  # fmt: skip

    def close(self) -> None:
        """No more pictures; viewers get None. Waits for the threads."""
        with self._changed:
            self._is_closed = True
            for seat in self._seats:
                seat.leave()
                seat.ready.set()
            feed = self._feed
            self._prune()
            worker = self._worker
        if feed is not None:
            feed.join()
        if worker is not None:
            worker.join()
        self._darkroom.search.join()

    def next_for(self, seat: Seat, timeout_s: float) -> LivePicture | None:
        """See `LiveViewer.next`."""
        with self._changed:
            if seat.is_gone:
                return None
            if seat.box is not None and self._view is not None and seat.had < self._view.number:
                seat.box = None
        if seat.box is None:
            self.ask_for(seat)
        seat.ready.wait(timeout_s)
        with self._changed:
            # Whoever has given up waiting is not worked for.
            seat.wants = False
            return self.take_for(seat)

    def ask_for(self, seat: Seat) -> None:
        """See `LiveViewer.acknowledge`."""
        with self._changed:
            if seat.is_gone:
                return
            seat.box = None
            seat.ready.clear()
            seat.wants = True
            number, picture = self._ready.get(seat.flavour, (0, None))
            is_current = self._view is not None and number == self._view.number
            if picture is not None and is_current and seat.had < number:
                _give(seat, number, picture)
                told = [seat]
            else:
                told = []
                self._changed.notify_all()
        self._tell(told)

    def take_for(self, seat: Seat) -> LivePicture | None:
        """See `LiveViewer.take`."""
        with self._changed:
            picture, seat.box = seat.box, None
            if not seat.is_gone:
                seat.ready.clear()
            return None if seat.is_gone else picture

    def forget_those_gone(self) -> None:
        """Viewers that left are not worked for; after the last of them nothing runs."""
        with self._changed:
            self._prune()

    def _begin(self) -> None:
        # What was seen before nobody looked is no live picture.
        self._view, self._ready = None, {}
        feed = Feed(self._camera, self._on_frame, self._on_lost)
        self._feed = feed
        self._worker = threading.Thread(
            target=self._work, args=(feed, self._worker), name="live pictures", daemon=True
        )
        self._worker.start()

    def _prune(self) -> None:
        self._seats = [seat for seat in self._seats if not seat.is_gone]
        flavours = {seat.flavour for seat in self._seats}
        self._ready = {flavour: ready for flavour, ready in self._ready.items() if flavour in flavours}
        if not self._seats and self._feed is not None:
            self._feed.stop()
            self._feed, self._view = None, None
        self._changed.notify_all()

    def _on_frame(self, frame: Frame) -> None:
        lit = tuple(self._lit())
        self._darkroom.dark.note(frame, is_lit=bool(lit))
        with self._changed:
            if self._feed is not None:
                self._number += 1
                self._view = View(self._number, frame, lit)
                self._changed.notify_all()

    def _on_lost(self, problem: str) -> None:
        self._darkroom.search.forget()
        with self._changed:
            if self._feed is not None:
                last = None if self._view is None else self._view.frame
                self._number += 1
                self._view = View(self._number, last, (), problem)
                self._changed.notify_all()

    def _work(self, feed: Feed, before: threading.Thread | None) -> None:
        if before is not None:
            # It was told to end; a darkroom is for one at a time.
            before.join()
        damaged = 0
        while (order := self._next_order(feed, damaged)) is not None:
            view, flavours, known, settings = order
            try:
                hand_out = partial(self._hand_out, view.number)
                took_s = self._darkroom.make(view, flavours, known, settings, hand_out)
            except DeviceError:
                # One bad picture; the next is on its way.
                damaged = view.number
            else:
                feed.rest(min(took_s * (1.0 / self._share - 1.0), _LONGEST_REST_S))
        with self._changed:
            if self._feed is None:
                self._darkroom.clear()

    def _next_order(self, feed: Feed, damaged: int) -> tuple[View, set[Flavour], Known, LiveSettings] | None:
        """What is to be made of which view, with what; None when it is over."""
        with self._changed:
            while True:
                if any(seat.is_gone for seat in self._seats):
                    self._prune()
                if feed.is_stopped:
                    return None
                view = self._view
                if view is not None and view.number != damaged:
                    wanted = {seat.flavour for seat in self._seats if seat.wants and seat.had < view.number}
                    now_s = time.monotonic()
                    early_s = self._next_s - now_s
                    if early_s > 0.0:
                        wanted = {flavour for flavour in wanted if flavour.is_as_it_comes}
                    elif any(not flavour.is_as_it_comes for flavour in wanted):
                        # In step with the clock, not with how long a picture took.
                        self._next_s = max(self._next_s + self._rest_s, now_s)
                    if wanted:
                        return view, wanted, self._known, self._settings
                    if early_s > 0.0:
                        self._changed.wait(early_s)
                        continue
                self._changed.wait(_TICK_S)

    def _hand_out(self, number: int, flavour: Flavour, picture: LivePicture) -> None:
        with self._changed:
            self._ready[flavour] = (number, picture)
            told = [
                seat for seat in self._seats
                if seat.flavour == flavour and seat.wants and not seat.is_gone and seat.had < number
            ]  # fmt: skip
            for seat in told:
                _give(seat, number, picture)
        self._tell(told)

    def _tell(self, seats: Sequence[Seat]) -> None:
        for seat in seats:
            if seat.on_ready is None:
                continue
            try:
                seat.on_ready()
            except Exception:  # noqa: BLE001 (whoever cannot be told any more has gone; the others have not)
                seat.leave()


def _give(seat: Seat, number: int, picture: LivePicture) -> None:
    if seat.had:
        # Frames count from 0 again when the camera is connected again.
        seat.skipped += max(0, picture.frame_index - seat.had_frame - 1)
    seat.box, seat.had, seat.had_frame, seat.wants = picture, number, picture.frame_index, False
    seat.ready.set()
