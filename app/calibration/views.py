"""What the pictures of one or more recordings show: boards, markers and stripes, one view at a time."""

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import TypeVar, get_args

import numpy as np

from app.calibration.coverage import Coverage
from app.errors import CalibrationError, FrameError
from app.recording.manifest import FrameEntry
from app.recording.reader import Recording
from app.recording.shot import Role, Shot
from app.vision.board import BoardObservation, BoardSpec, detect_board
from app.vision.markers import MarkerObservation, PlatterSpec, detect_markers
from app.vision.stripe import LaserStripe, LaserView, Orientation, StripeDetector

T = TypeVar("T")

_WORKERS = 2
# Markers repeat themselves from stop to stop; more views of them add time and no knowledge.
_MOST_MARKER_VIEWS = 200
# Neighbours on a true stripe are this near; one over this share of the picture's lines is sure.
_SMOOTH_PX = 2.0
_CLEAR_SHARE = 0.6
_NO_BOARD = BoardObservation(np.zeros(0, np.intp), np.zeros((0, 2)), np.zeros((0, 3)))
_NO_MARKERS = MarkerObservation(np.zeros(0, np.intp), np.zeros((0, 4, 2)))
_ON_TABLE = (Role.AXIS, Role.SCAN, Role.TEXTURE, Role.BACKGROUND)


@dataclass(frozen=True, eq=False, slots=True)
class View:
    """Everything seen of one situation: one pose of the board, or one stop of the table.

    Attributes:
        name: the frame that shows it, for messages.
        role: what it was taken for.
        placement: views of one placement share the board's pose on the table; empty for a free board.
        angle_rad: table angle, right-handed about the upward axis; NaN where unknown.
        board: corners of the board.
        markers: markers on the table.
        stripes: the stripe of each laser, over the whole picture.
        across: for each laser, 0 where its stripe was located along u (it runs down the picture), else 1.
        together: lasers whose stripes come from one picture, so that either may be the other's.
    """

    name: str
    role: Role
    placement: str
    angle_rad: float
    board: BoardObservation
    markers: MarkerObservation
    stripes: Mapping[str, LaserStripe]
    across: Mapping[str, int] = field(default_factory=dict)
    together: tuple[str, ...] = ()

    def across_of(self, laser: str) -> int:
        """0 where the laser's stripe was located along u, which is usual, or 1."""
        return self.across.get(laser, 0)

    @property
    def is_on_table(self) -> bool:
        return self.role in _ON_TABLE


@dataclass(frozen=True, eq=False, slots=True)
class Evidence:
    """All views that calibration can use.

    Attributes:
        size: width and height of the pictures, px.
        lasers: names of the lasers of all recordings.
        board: the board that was used; None where no frame shows one.
        platter: the markers on the table; None where there are none.
        views: what was seen.
        skipped: frames that could not be used, and why.
    """

    size: tuple[int, int]
    lasers: tuple[str, ...]
    board: BoardSpec | None
    platter: PlatterSpec | None
    views: tuple[View, ...]
    skipped: tuple[tuple[str, str], ...] = field(default=())

    def coverage(self) -> Coverage:
        """Where in the picture the board's corners were."""
        return Coverage.of([view.board.corners for view in self.views if view.board.is_found], self.size)


@dataclass(frozen=True, slots=True)
class _Situation:
    """Frames that belong to one view."""

    recording: Recording
    placement: str
    angle_rad: float
    entries: tuple[FrameEntry, ...]


def gather(
    recordings: Sequence[Recording],
    detector: StripeDetector,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
    *,
    skips_bad_frames: bool = False,
) -> Evidence:
    """Look at every frame that tells something about the rig.

    Args:
        recordings: of one rig, all with the same picture size, board and markers.
        detector: finds the stripes.
        on_progress: told how many situations of how many are done.
        skips_bad_frames: go on without pictures that cannot be read, and list them.

    Raises:
        FrameError: a picture cannot be read.
        CalibrationError: the recordings do not belong together.
    """
    size = _common("picture size", [r.camera_size for r in recordings])
    board = _common("board", [r.board for r in recordings if r.board is not None])
    platter = _common("platter", [r.platter for r in recordings if r.platter is not None])
    if size is None:
        raise CalibrationError("No recording was named.", "Name at least one recording.")
    situations = [s for number, r in enumerate(recordings) for s in _situations(r, number, len(recordings))]
    views: list[View] = []
    skipped: list[tuple[str, str]] = []
    for done, (view, problems) in enumerate(_look_at_all(situations, detector, skips_bad_frames), start=1):
        views += [view] if view is not None else []
        skipped += problems
        on_progress(done, len(situations))
    lasers = tuple(dict.fromkeys(name for r in recordings for name in r.lasers))
    return Evidence(size, lasers, board, platter, tuple(views), tuple(skipped))


def _common(what: str, values: Sequence[T]) -> T | None:
    for value in values[1:]:
        if value != values[0]:
            raise CalibrationError(
                f"The recordings are not of one rig: {what} is {values[0]} in one and {value} in another.",
                "Calibrate them apart, or correct recording.json.",
            )
    return values[0] if values else None


def _situations(recording: Recording, number: int, count: int) -> Iterator[_Situation]:
    prefix = f"{recording.folder.name}:" if count > 1 else ""
    groups: dict[tuple[object, ...], list[FrameEntry]] = {}
    stops: dict[tuple[object, ...], list[FrameEntry]] = {}
    for index, entry in enumerate(recording.entries):
        if entry.role in (Role.SCAN, Role.TEXTURE, Role.BACKGROUND):
            key = (number, "stop", index if entry.angle_deg is None else entry.angle_deg)
            stops.setdefault(key, []).append(entry)
        elif entry.role is Role.INTRINSICS:
            groups[(number, entry.role, index)] = [entry]
        elif entry.role is Role.AXIS:
            groups.setdefault((number, entry.role, entry.pose, entry.angle_deg), []).append(entry)
        else:
            pose = index if entry.pose is None else entry.pose
            groups.setdefault((number, entry.role, pose), []).append(entry)
    chosen = list(groups.values())
    if recording.platter is not None:
        picked = np.unique(np.linspace(0, len(stops) - 1, min(len(stops), _MOST_MARKER_VIEWS)).astype(int))
        chosen += [list(stops.values())[i] for i in picked if stops]
    for entries in chosen:
        first = entries[0]
        angle = float("nan") if first.angle_deg is None else recording.turn_rad(first.angle_deg)
        placement = f"{prefix}{first.pose}" if first.role is Role.AXIS else ""
        yield _Situation(recording, placement, angle, tuple(entries))


def _look_at_all(
    situations: Sequence[_Situation], detector: StripeDetector, skips_bad_frames: bool
) -> Iterator[tuple[View | None, list[tuple[str, str]]]]:
    """In order, a few ahead, so that pictures are decoded on one core while the other looks."""
    waiting: deque[Future[tuple[View | None, list[tuple[str, str]]]]] = deque()
    with ThreadPoolExecutor(_WORKERS, "calibration-views") as pool:
        try:
            for situation in situations:
                waiting.append(pool.submit(_look_at, situation, detector, skips_bad_frames))
                if len(waiting) > 2 * _WORKERS:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _look_at(
    situation: _Situation, detector: StripeDetector, skips_bad_frames: bool
) -> tuple[View | None, list[tuple[str, str]]]:
    shots: list[Shot] = []
    problems: list[tuple[str, str]] = []
    has_dark = any(not entry.lasers_on for entry in situation.entries)
    for entry in situation.entries:
        # JPEG keeps colours at half the size, which shifts stripes: with a dark partner brightness will do.
        grey = has_dark and entry.file.lower().endswith((".jpg", ".jpeg"))
        try:
            shots.append(situation.recording.load(entry, grey=grey))
        except FrameError as error:
            if not skips_bad_frames:
                raise
            problems.append((entry.file, error.problem))
    if not shots:
        return None, problems
    recording = situation.recording
    role = shots[0].role
    dark = next((shot for shot in shots if not shot.lasers_on), None)
    lit = [shot for shot in shots if shot.lasers_on]
    wants_board = role in (Role.INTRINSICS, Role.LASER_PLANE, Role.AXIS, Role.AXIS_LINE)
    board = _NO_BOARD
    if wants_board and recording.board is not None:
        board = _first_board([dark] if dark is not None else lit, recording.board)
        if not board.is_found:
            problems.append((shots[0].name, "the board was not found"))
    markers = _NO_MARKERS
    if recording.platter is not None and role in _ON_TABLE:
        markers = detect_markers((dark or lit[0]).image, recording.platter)
    if not board.is_found and len(markers.ids) == 0:
        return None, problems
    stripes: dict[str, LaserStripe] = {}
    across: dict[str, int] = {}
    together: tuple[str, ...] = ()
    for shot in lit:
        colour = recording.lasers[shot.lasers_on[0]]
        looks = [
            LaserView(shot.image, None if dark is None else dark.image, colour, way)
            for way in get_args(Orientation)
        ]
        if len(shot.lasers_on) > 1:
            together = shot.lasers_on
        found, orientation = _best_stripes(looks, len(shot.lasers_on), detector)
        for name, stripe in zip(shot.lasers_on, found, strict=False):
            if len(stripe):
                stripes[name] = stripe
                across[name] = 0 if orientation == "vertical" else 1
            else:
                problems.append((shot.name, f"laser {name} was not seen"))
    view = View(
        shots[0].name, role, situation.placement, situation.angle_rad, board, markers, stripes, across,
        together,
    )  # fmt: skip
    return view, problems


def _first_board(shots: Sequence[Shot], spec: BoardSpec) -> BoardObservation:
    for shot in shots:
        found = detect_board(shot.image, spec)
        if found.is_found:
            return found
    return _NO_BOARD


def _best_stripes(
    looks: Sequence[LaserView], count: int, detector: StripeDetector
) -> tuple[list[LaserStripe], Orientation]:
    """The stripes of one picture and the way they run: the way in which they hang together over more lines.

    Several lasers in one picture are taken to be listed from left to right.
    """
    best: tuple[list[LaserStripe], Orientation] = ([], "vertical")
    most = -1
    for look in looks:
        stripes = [detector.detect(look)] if count == 1 else detector.detect_several(look, count)
        across = 0 if look.orientation == "vertical" else 1
        joined = sum(int(np.sum(np.abs(np.diff(s.pixels[:, across])) < _SMOOTH_PX)) for s in stripes)
        if joined > most:
            best, most = (stripes, look.orientation), joined
        if joined > _CLEAR_SHARE * look.lit.shape[across]:
            break
    return best
