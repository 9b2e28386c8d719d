"""Calibration pictures on disk: every one is there before it is used, and another run can go on."""

from pathlib import Path
from typing import Self

from app.calibration.capture_views import CameraViews, seen_json
from app.calibration.struck import Struck
from app.devices.bench import Bench
from app.devices.frame import Frame
from app.errors import RecordingError
from app.recording.journal import JOURNAL_FILE, MANIFEST_FILE
from app.recording.manifest import FrameEntry, Header
from app.recording.reader import Recording
from app.recording.shot import Role
from app.recording.writer import RecordingWriter
from app.vision.board import BoardObservation, BoardSpec, detect_board

FEWEST_STOPS = 5
"""A placement of the board with so many angles is whole."""


class CaptureSession:
    """One recording as it grows.

    Attributes:
        folder: of the recording.
        board: what its pictures show.
        struck: views that are left out.
    """

    def __init__(self, writer: RecordingWriter, board: BoardSpec, struck: Struck) -> None:
        self.folder, self.board, self.struck, self._writer = writer.folder, board, struck, writer
        times = [entry.time_s for entry in writer.entries if entry.time_s is not None]
        self._last_s = max(times) + 1.0 if times else 0.0
        self._began_s: float | None = None

    @classmethod
    def create(cls, folder: Path, bench: Bench, board: BoardSpec, struck: Struck | None = None) -> Self:
        """Start in a new or empty folder.

        Args:
            folder: of the recording.
            bench: with its camera connected.
            board: what will be shown.
            struck: views that are left out, where somebody else decides about them, too.

        Raises:
            OutputError: the folder holds something, or cannot be made.
        """
        writer = RecordingWriter.create(folder, _header(bench, board))
        return cls(writer, board, struck or Struck(folder))

    @classmethod
    def resume(cls, folder: Path, bench: Bench, board: BoardSpec, struck: Struck | None = None) -> Self:
        """Go on with a recording that was interrupted.

        Raises:
            RecordingError: there is none, or it is of another bench.
        """
        there = Recording.open(folder)
        if there.camera_size != bench.camera.facts.size or there.board != board:
            raise RecordingError(
                str(folder), "is of another board or another size of pictures",
                "Go on with the bench it was begun with, or name a new folder.",
            )  # fmt: skip
        return cls(RecordingWriter.resume(folder), board, struck or Struck.load(folder))

    @staticmethod
    def is_begun(folder: Path) -> bool:
        """Whether there is a recording to go on with."""
        return any((folder / name).is_file() for name in (JOURNAL_FILE, MANIFEST_FILE))

    @property
    def pictures(self) -> int:
        return len(self._writer.entries)

    @property
    def placements(self) -> int:
        """How many placements of the board are whole."""
        return sum(len(angles) >= FEWEST_STOPS for angles in self._angles.values())

    @property
    def next_pose(self) -> int:
        """A number that no pose has yet."""
        return max((entry.pose for entry in self._writer.entries if entry.pose is not None), default=-1) + 1

    def views(self) -> CameraViews:
        """The camera's views that are there."""
        views = CameraViews(self._writer.header.camera_size, self.struck)
        entries = [(n, e) for n, e in enumerate(self._writer.entries) if e.role is Role.INTRINSICS]
        if entries:
            recording = Recording.open(self.folder)
            for number, entry in entries:
                seen = detect_board(recording.load(entry).image, self.board)
                if seen.is_found:
                    views.add(number, seen)
        return views

    def record(
        self,
        frame: Frame,
        role: Role,
        lasers: tuple[str, ...] = (),
        angle_deg: float | None = None,
        pose: int | None = None,
        seen: BoardObservation | None = None,
    ) -> int:
        """Put a picture on disk; the number of its entry. Raises as `RecordingWriter.append_encoded`."""
        if self._began_s is None:
            self._began_s = frame.exposed_s - self._last_s
        self._writer.append_encoded(
            frame.encoded(), role, lasers, angle_deg,
            pose=pose, time_s=max(0.0, frame.exposed_s - self._began_s), exposure_us=frame.exposure_us,
            extra=None if seen is None else seen_json(seen),
        )  # fmt: skip
        return len(self._writer.entries) - 1

    def suspend(self) -> None:
        """Let go of the files, for another run to go on with; without a picture nothing stays."""
        if self.pictures:
            self._writer.suspend()
        else:
            self._writer.discard()

    def finish(self) -> Recording:
        """Everything is taken. Raises OutputError."""
        return self._writer.close()

    @property
    def camera_views(self) -> int:
        """How many views of the camera count."""
        return len(self._counted(Role.INTRINSICS))

    @property
    def empty_stops(self) -> int:
        """At how many angles the empty table was photographed."""
        return len({entry.angle_deg for entry in self._counted(Role.BACKGROUND)})

    @property
    def laser_poses(self) -> int:
        """How many poses of the board were photographed with every laser while the table stood."""
        wanted = len(self._writer.header.lasers)
        lit: dict[int, int] = {}
        for number, entry in enumerate(self._writer.entries):
            if entry.role is Role.LASER_PLANE and entry.pose is not None:
                is_out = number in self.struck.reasons
                lit[entry.pose] = lit.get(entry.pose, 0) + len(entry.lasers_on) - 1000 * is_out
        return sum(count >= wanted for count in lit.values())

    def _counted(self, role: Role) -> list[FrameEntry]:
        out = self.struck.reasons
        return [e for n, e in enumerate(self._writer.entries) if e.role is role and n not in out]

    @property
    def _angles(self) -> dict[int, set[float]]:
        """Angles of each placement that were photographed with every laser."""
        last = list(self._writer.header.lasers)[-1:]
        angles: dict[int, set[float]] = {}
        struck = self.struck.reasons
        entries = [(n, e) for n, e in enumerate(self._writer.entries) if e.role is Role.AXIS]
        out = {(entry.pose, entry.angle_deg) for number, entry in entries if number in struck}
        for _, entry in entries:
            if entry.pose is None or entry.angle_deg is None:
                continue
            mine = angles.setdefault(entry.pose, set())
            if last and last[0].name in entry.lasers_on and (entry.pose, entry.angle_deg) not in out:
                mine.add(entry.angle_deg)
        return angles


def _header(bench: Bench, board: BoardSpec) -> Header:
    description = bench.description
    return Header.of(
        bench.camera.facts.size,
        {laser.name: laser.colour for laser in description.lasers},
        direction=description.turntable.direction,
        board=board,
        platter=None if description.platter is None else description.platter.spec(),
        camera_name=bench.camera.facts.name,
        extra={"bench": description.name},
    )
