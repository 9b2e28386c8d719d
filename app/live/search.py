"""Board and markers are looked for beside the pictures, because that may take longer than a picture lasts."""

import math
import threading
import time
from dataclasses import dataclass, replace

from app.errors import ScannerError
from app.live.known import Known
from app.live.settings import LiveSettings
from app.vision.board import BoardObservation, BoardSpec, detect_board
from app.vision.markers import MarkerObservation, detect_markers
from app.vision.overlay import shrunk
from app.vision.stripe import Image

# A search may take this share of one processor, and OpenCV's own threads take about as much again; it is not
# begun more often than that.
_SHARE = 0.04
# The board is looked for in a picture no wider than this: what is painted need not be exact, and a board that
# is not there is looked for longest.
_WIDEST = 800
_LEAST_PAUSE_S = 0.2
# What was seen longer ago than this is not painted any more, unless a search takes that long.
_BELIEVED_S = 1.0


@dataclass(frozen=True, eq=False, slots=True)
class Found:
    """What a search saw.

    Attributes:
        board, markers: None where they were not looked for.
    """

    board: BoardObservation | None = None
    markers: MarkerObservation | None = None

    @property
    def corners(self) -> int:
        """How many of the board."""
        return len(self.board.ids) if self.board is not None and self.board.is_found else 0


class Search:
    """At most one search at a time, each in a thread that ends with it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self._found, self._seen_s = Found(), -math.inf
        self._again_s, self._took_s = -math.inf, 0.0

    def offer(self, image: Image, known: Known, settings: LiveSettings) -> None:
        """Look at this picture, if it is time to; never waits."""
        board = known.board if settings.shows_board else None
        platter = known.platter if settings.shows_markers else None
        if board is None and platter is None:
            return
        only = Known(board=board, platter=platter)
        with self._lock:
            if self._thread is not None or time.monotonic() < self._again_s:
                return
            self._thread = threading.Thread(
                target=self._look, args=(image, only), name="live search", daemon=True
            )
            self._thread.start()

    def found(self, settings: LiveSettings) -> Found:
        """What was seen lately, and is to be shown."""
        with self._lock:
            age_s = time.monotonic() - self._seen_s
            if age_s > max(_BELIEVED_S, 2.0 * self._took_s / _SHARE):
                return Found()
            found = self._found
        return Found(
            found.board if settings.shows_board else None, found.markers if settings.shows_markers else None
        )

    def forget(self) -> None:
        """What was seen is not there any more."""
        with self._lock:
            self._found, self._seen_s = Found(), -math.inf

    def join(self) -> None:
        """Wait for a search that is under way."""
        with self._lock:
            thread = self._thread
        if thread is not None:
            thread.join()

    def _look(self, image: Image, known: Known) -> None:
        began_s = time.thread_time()
        found = Found()
        try:
            found = Found(
                None if known.board is None else _seen_small(image, known.board),
                None if known.platter is None else detect_markers(image, known.platter),
            )
        except ScannerError:
            # A board or dictionary that cannot be is told where it is configured.
            found = Found()
        finally:
            now_s = time.monotonic()
            with self._lock:
                self._took_s = time.thread_time() - began_s
                self._found, self._seen_s = found, now_s
                self._again_s = now_s + max(_LEAST_PAUSE_S, self._took_s * (1.0 / _SHARE - 1.0))
                self._thread = None


def _seen_small(image: Image, board: BoardSpec) -> BoardObservation:
    """The board as a smaller picture shows it, in pixels of the whole one."""
    factor = math.ceil(image.shape[1] / _WIDEST)
    small = shrunk(image, image.shape[1] // factor)
    scale = image.shape[1] / small.shape[1]
    seen = detect_board(small, board)
    return replace(seen, corners=(seen.corners + 0.5) * scale - 0.5)
