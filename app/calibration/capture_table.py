"""Views for lasers and axis: the board stands on the table, which turns; every laser is lit in turn."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from app.calibration.capture_camera import whole_board
from app.calibration.capture_events import CaptureEvent, EventKind, Watch
from app.calibration.capture_goals import Stance
from app.calibration.capture_session import FEWEST_STOPS, CaptureSession
from app.devices.bench import Bench
from app.devices.frame import Frame, Use
from app.errors import CalibrationError
from app.geometry.arrays import Pixels
from app.recording.shot import Role
from app.vision.board import BoardObservation, detect_board

_SEARCH_DEG, _STEP_DEG = 20.0, 15.0
_FURTHEST_DEG = 60.0
# Corners of a board that is seen more from the side are poor.
_OBLIQUE_DEG = 50.0
# Further to the side a laser grazes the board, and its stripe is found where it is not.
_WIDEST_DEG = 60.0
_MOST_STOPS, _STOP_DEG = 7, 10.0
_NARROWEST_DEG = 12.0
_BY_HAND_DEG = (-28.0, -14.0, 0.0, 14.0, 28.0)
# A laser may stay lit no longer than this for a picture that does not come.
_PICTURE_S, _PICTURE_PERIODS = 0.6, 8.0
_EMPTY = np.zeros((0, 2))


@dataclass(frozen=True, slots=True)
class Span:
    """Where the table shows the board.

    Attributes:
        angles_deg: of the stops, growing.
        use: settings of the camera with which it is seen.
    """

    angles_deg: tuple[float, ...]
    use: Use

    def between(self) -> "Span":
        """Stops in the middle between these."""
        places = np.array(self.angles_deg)
        return Span(tuple(float(a) for a in (places[1:] + places[:-1]) / 2.0), self.use)


class TableCapture:
    """Turns the table and takes pictures of the board on it.

    Args:
        bench: leased by the caller, connected.
        session: where the pictures go.
        watch: told of every stop.
        stage: for the events.
    """

    def __init__(self, bench: Bench, session: CaptureSession, watch: Watch, stage: str = "board") -> None:
        self.bench, self.session, self.watch, self.stage = bench, session, watch, stage

    def find(self, from_deg: float) -> Span:
        """The angles about `from_deg` at which the whole board is seen, not too much from the side.

        Raises:
            CalibrationError: it is seen nowhere, or over too small a range.
            DeviceError: a device failed.
        """
        self.bench.turntable.hold(True)
        if self.bench.turntable.facts.lasers_by_hand:
            return Span(tuple(from_deg + a for a in _BY_HAND_DEG), Use.LASER)
        found = self._found(from_deg)
        if found is None:
            raise CalibrationError(
                "The whole board is not seen at any angle of the table.",
                "Stand it a little beside the axis, facing the camera, and check the board's entry in the "
                "bench file and the exposure.",
            )
        seen_deg, use = found
        high = self._edge(seen_deg, _STEP_DEG, use)
        low = self._edge(seen_deg, -_STEP_DEG, use)
        middle, half = (low + high) / 2.0, min(high - low, _WIDEST_DEG) / 2.0
        low, high = middle - half, middle + half
        if high - low < _NARROWEST_DEG:
            raise CalibrationError(
                f"The whole board is seen over {high - low:.0f} degrees of the table only.",
                "Stand it nearer to the axis, facing the camera, so that it stays in the picture while it "
                "turns; or use a smaller board.",
            )
        stops = int(np.clip(round((high - low) / _STOP_DEG) + 1, FEWEST_STOPS, _MOST_STOPS))
        return Span(tuple(float(a) for a in np.linspace(low, high, stops)), use)

    def take(self, span: Span, pose: int) -> None:
        """One picture without light and one with each laser, at every stop.

        Raises:
            DeviceError: a device failed; the lasers are off, and what was taken is on disk.
        """
        for number, angle_deg in enumerate(span.angles_deg, start=1):
            reached_deg, stops = self._turn(angle_deg), len(span.angles_deg)
            words = f"{reached_deg:.0f} degrees, {number} of {stops}"
            self._take_view(Role.AXIS, span.use, pose, reached_deg, words, number / stops)

    def take_pose(self, pose: int, done: float) -> None:
        """The board where it stands or is held now, without light and with each laser; the table stays.

        Raises:
            CalibrationError: the whole board is not in the picture.
            DeviceError: a device failed.
        """
        settings = self.bench.camera.settings
        is_one = settings.get(Use.LASER) == settings.get(Use.BOARD)
        for use in (Use.LASER,) if is_one else (Use.LASER, Use.BOARD):
            if whole_board(self.photograph((), use), self.session.board).is_found:
                self._take_view(Role.LASER_PLANE, use, pose, None, f"pose {pose + 1}", done)
                return
        raise CalibrationError(
            "The whole board is not in the picture.", "Move it until all of it is seen, and try again."
        )

    def _take_view(
        self, role: Role, use: Use, pose: int, angle_deg: float | None, words: str, done: float
    ) -> None:
        dark = self.photograph((), use)
        seen = detect_board(dark.image(), self.session.board)
        view = self.session.record(dark, role, (), angle_deg, pose, seen)
        for name in self.bench.lasers:
            self.session.record(self.photograph((name,), use), role, (name,), angle_deg, pose)
        event = CaptureEvent(
            EventKind.TAKEN, words, self.stage, done, self.session.pictures, seen.corners, view
        )  # fmt: skip
        self.watch(event)

    def take_empty(self, angles_deg: Sequence[float]) -> None:
        """The table without anything on it, every laser at every stop: it shows how high the table is."""
        for number, angle_deg in enumerate(angles_deg, start=1):
            reached_deg = self._turn(angle_deg)
            # Without a dark partner the stripe is looked for in its own colour: a table is often too dark for
            # the brightness that JPEG partners are compared by.
            for name in self.bench.lasers:
                frame = self.photograph((name,), Use.LASER)
                self.session.record(frame, Role.BACKGROUND, (name,), reached_deg)
            self._tell(
                EventKind.TAKEN, f"empty table, {number} of {len(angles_deg)}", number / len(angles_deg),
                _EMPTY,
            )  # fmt: skip

    def photograph(self, lasers: tuple[str, ...], use: Use) -> Frame:
        """A picture that was exposed after the lasers came on."""
        self.bench.camera.prepare(use)
        timeout_s = _PICTURE_S + _PICTURE_PERIODS / max(self.bench.camera.facts.fps, 1.0)
        with self.bench.lit(*lasers):
            return self.bench.camera.fresh_frame(timeout_s=timeout_s)

    def _found(self, from_deg: float) -> tuple[float, Use] | None:
        """The first angle at which the board is seen well, and the settings with which it is."""
        settings = self.bench.camera.settings
        is_one = settings.get(Use.LASER) == settings.get(Use.BOARD)
        for angle_deg in _around(from_deg):
            self._turn(angle_deg)
            for use in (Use.LASER,) if is_one else (Use.LASER, Use.BOARD):
                if self._is_seen(use, angle_deg):
                    return angle_deg, use
        return None

    def _edge(self, from_deg: float, step_deg: float, use: Use) -> float:
        """The last angle in one direction at which the board is still seen well."""
        edge_deg = from_deg
        while abs(edge_deg + step_deg - from_deg) <= _FURTHEST_DEG:
            self._turn(edge_deg + step_deg)
            if not self._is_seen(use, edge_deg + step_deg):
                break
            edge_deg += step_deg
        return edge_deg

    def _is_seen(self, use: Use, angle_deg: float) -> bool:
        seen = whole_board(self.photograph((), use), self.session.board)
        is_well_seen = seen.is_found and self._oblique_deg(seen) <= _OBLIQUE_DEG
        words = f"looking at {angle_deg:.0f} degrees: the board is {'seen' if is_well_seen else 'not seen'}"
        self._tell(EventKind.TURNING, words, 0.0, seen.corners)
        return is_well_seen

    def _oblique_deg(self, seen: BoardObservation) -> float:
        return Stance.of(seen, self.bench.camera.facts.size).oblique_deg

    def _turn(self, angle_deg: float) -> float:
        reached_deg = self.bench.turntable.move_to(angle_deg)
        time.sleep(self.bench.description.turntable.settle_s)
        return reached_deg

    def _tell(self, kind: EventKind, words: str, done: float, corners: Pixels) -> None:
        self.watch(CaptureEvent(kind, words, self.stage, done, self.session.pictures, corners))


def _around(from_deg: float) -> Iterator[float]:
    """Once around, the nearest first as far as that needs no long way back."""
    yield from_deg
    for turn in range(1, round(360.0 / _SEARCH_DEG)):
        yield from_deg + turn * _SEARCH_DEG
