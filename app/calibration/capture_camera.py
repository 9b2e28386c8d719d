"""Views for the camera: a board that somebody holds is photographed by itself when it is worth it."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from app.calibration.capture_events import CaptureEvent, EventKind, Watch
from app.calibration.capture_goals import ENOUGH_VIEWS, Goals, Stance
from app.calibration.capture_session import CaptureSession
from app.calibration.capture_views import CameraViews
from app.devices.bench import Bench
from app.devices.frame import Frame, Use
from app.errors import CalibrationError
from app.geometry.arrays import Pixels
from app.recording.shot import Role
from app.vision.board import BoardObservation, BoardSpec, detect_board

STAGE = "camera"
FEWEST_VIEWS = 8
"""A camera is not calibrated from fewer."""
# Between two pictures; more than noise does to good corners, less than would blur them.
_STILL_PX = 0.5
_WHOLE_SHARE = 0.9
_EMPTY = np.zeros((0, 2))


@dataclass(frozen=True, slots=True)
class CameraLimits:
    """When to stop asking for more.

    Attributes:
        views: at most so many.
        seconds: at most so long.
        is_enough: asked between pictures; True ends it as if the time were over.
        is_wanted: asked between pictures; True takes the next one that shows the whole board, whatever it
            adds.
    """

    views: int = 40
    seconds: float = 300.0
    is_enough: Callable[[], bool] = field(default=lambda: False)
    is_wanted: Callable[[], bool] = field(default=lambda: False)


def capture_camera_views(
    bench: Bench, session: CaptureSession, views: CameraViews, watch: Watch, limits: CameraLimits
) -> None:
    """Take a view whenever the whole board stands still and adds something, until the goals are reached.

    Args:
        bench: leased by the caller, connected.
        session: where the pictures go.
        views: what there is already; added to.
        watch: told of every picture of the camera.
        limits: see there.

    Raises:
        CalibrationError: the limits were reached with hardly any view.
        DeviceError: the camera failed; the same call goes on where this one ended.
    """
    ends_s = time.monotonic() + limits.seconds
    bench.camera.prepare(Use.BOARD)
    before: BoardObservation | None = None
    told, is_wanted = "", False
    after_s = time.monotonic()
    while (goals := views.goals).wish is not None and len(goals.stances) < limits.views:
        if time.monotonic() > ends_s or limits.is_enough():
            _refuse_few(goals)
            return
        if goals.wanted != told:
            told = goals.wanted
            watch(replace(_event(EventKind.WANTED, told, goals, _EMPTY), wish=goals.wish))
        frame = bench.camera.fresh_frame(after_s=after_s)
        # Begun after the one before, so that two pictures show whether it moves.
        after_s = frame.exposed_s + 1e-6
        seen = whole_board(frame, session.board)
        kind, words = _judged(seen, before, goals)
        is_wanted = is_wanted or limits.is_wanted()
        if is_wanted and kind in (EventKind.MOVING, EventKind.SEEN):
            kind, words = EventKind.TAKEN, "as asked for"
        before = seen
        if kind is not EventKind.TAKEN:
            watch(_event(kind, words, goals, seen.corners))
            continue
        is_wanted = False
        number = session.record(frame, Role.INTRINSICS, seen=seen)
        views.add(number, seen)
        watch(replace(_event(kind, words, views.goals, seen.corners), view=number))
        rms_px = views.rate()
        if rms_px:
            watch(replace(_event(EventKind.RATED, words, views.goals, seen.corners), rms_px=rms_px))


def whole_board(frame: Frame, board: BoardSpec) -> BoardObservation:
    """The board in a picture; empty where it is not, or not all of it."""
    seen = detect_board(frame.image(), board)
    rows, columns = board.shape
    return seen if len(seen.ids) >= _WHOLE_SHARE * rows * columns else BoardObservation.empty()


def _judged(seen: BoardObservation, before: BoardObservation | None, goals: Goals) -> tuple[EventKind, str]:
    if not seen.is_found:
        return EventKind.UNSEEN, "the whole board is not in the picture"
    if before is None or not before.is_found or _moved_px(before, seen) > _STILL_PX:
        return EventKind.MOVING, "hold it still"
    gain = goals.gain(Stance.of(seen, goals.size))
    return (EventKind.TAKEN, gain) if gain else (EventKind.SEEN, "seen like this already")


def _moved_px(before: BoardObservation, now: BoardObservation) -> float:
    """How far the corners went, as most of them say."""
    _, first, second = np.intersect1d(before.ids, now.ids, return_indices=True)
    if len(first) == 0:
        return float("inf")
    return float(np.median(np.linalg.norm(now.corners[second] - before.corners[first], axis=1)))


def _refuse_few(goals: Goals) -> None:
    if len(goals.stances) < FEWEST_VIEWS:
        raise CalibrationError(
            f"Only {len(goals.stances)} views of the board were taken; {ENOUGH_VIEWS} or more are wanted.",
            f"Go on, and {goals.wanted or 'show the board'}.",
        )


def _event(kind: EventKind, words: str, goals: Goals, corners: Pixels) -> CaptureEvent:
    return CaptureEvent(kind, words, STAGE, goals.done, len(goals.stances), corners)
