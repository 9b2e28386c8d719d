"""A recording on disk, read one frame at a time."""

import math
from collections import deque
from collections.abc import Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Literal

from app.documents import Json, read_document
from app.errors import FrameError, RecordingError
from app.files import reason
from app.recording.journal import JOURNAL_FILE, MANIFEST_FILE, read_journal
from app.recording.manifest import FrameEntry, Manifest
from app.recording.picture import decode
from app.recording.shot import Role, Shot
from app.vision.board import BoardSpec
from app.vision.markers import PlatterSpec
from app.vision.stripe import LaserColour

_OPEN_HINT = "Name a folder that holds recording.json, or make one with `turnscan import`."


class Recording:
    """Shots on disk, in the order they were taken; never more of them in memory than were asked for.

    Attributes:
        folder: where it lies.
        manifest: what `recording.json` says.
        is_interrupted: it was never closed, and is read from the journal of its writer.
        left_out: files of an interrupted recording whose picture never reached the disk.
    """

    def __init__(
        self,
        folder: Path,
        manifest: Manifest,
        *,
        is_interrupted: bool = False,
        left_out: tuple[str, ...] = (),
    ) -> None:
        self.folder, self.manifest = folder, manifest
        self.is_interrupted, self.left_out = is_interrupted, left_out
        _check_files(folder, manifest)

    @classmethod
    def open(cls, path: Path | str) -> "Recording":
        """The recording in a folder; the path of its `recording.json` will do too.

        Every entry is checked and every picture must be there; pictures are decoded when they are asked for.

        Raises:
            RecordingError: naming the file and entry.
            FrameError: a picture is missing.
        """
        folder = Path(path)
        if folder.name in (MANIFEST_FILE, JOURNAL_FILE):
            folder = folder.parent
        if not folder.is_dir():
            raise RecordingError(str(folder), "is not a folder", _OPEN_HINT)
        # A journal that is still there is newer than the manifest beside it.
        if (folder / JOURNAL_FILE).is_file():
            recovery = read_journal(folder)
            return cls(folder, recovery.manifest, is_interrupted=True, left_out=recovery.left_out)
        if not (folder / MANIFEST_FILE).is_file():
            raise RecordingError(str(folder), f"has no {MANIFEST_FILE}", _OPEN_HINT)
        return cls(folder, read_document(folder / MANIFEST_FILE, Manifest, RecordingError))

    @property
    def entries(self) -> tuple[FrameEntry, ...]:
        return self.manifest.frames

    @property
    def camera_size(self) -> tuple[int, int]:
        """Width and height of every frame, pixels."""
        return self.manifest.camera_size

    @property
    def lasers(self) -> Mapping[str, LaserColour]:
        """Colour of every laser by name."""
        return {laser.name: laser.colour for laser in self.manifest.lasers}

    @property
    def board(self) -> BoardSpec | None:
        """The calibration board; None where the recording names none."""
        return None if self.manifest.board is None else self.manifest.board_spec()

    @property
    def platter(self) -> PlatterSpec | None:
        """The markers on the table; None where there are none."""
        return None if self.manifest.platter is None else self.manifest.platter_spec()

    @property
    def direction(self) -> Literal["ccw", "cw"]:
        """Which way the table turns as angles grow, seen from above."""
        return "ccw" if self.manifest.turntable is None else self.manifest.turntable.direction

    @property
    def seconds_per_turn(self) -> float | None:
        """Of a table that turns steadily; None where it moves in steps."""
        return None if self.manifest.turntable is None else self.manifest.turntable.seconds_per_turn

    @property
    def extra(self) -> Json:
        """Top-level keys that the format does not know."""
        return self.manifest.unknown

    def turn_rad(self, angle_deg: float) -> float:
        """A table angle of this recording as a right-handed turn about the upward axis: `ccw` is positive."""
        return math.radians(angle_deg if self.direction == "ccw" else -angle_deg)

    def angle_deg(self, entry: FrameEntry) -> float | None:
        """Angle of a frame: as commanded, or by its time where the table turns steadily; None if unknown.

        Time 0 is angle 0.
        """
        if entry.angle_deg is not None:
            return entry.angle_deg
        if self.seconds_per_turn is None or entry.time_s is None:
            return None
        return 360.0 * entry.time_s / self.seconds_per_turn

    def select(self, *roles: Role) -> tuple[FrameEntry, ...]:
        """Entries of these roles (of all, where none is named), in order."""
        return tuple(entry for entry in self.entries if not roles or entry.role in roles)

    def load(self, entry: FrameEntry, *, grey: bool = False) -> Shot:
        """Decode one frame, as stored: orientation tags of the camera are ignored.

        Args:
            entry: one of `entries`.
            grey: luminance only, which decodes a JPEG in about half the time.

        Raises:
            FrameError: missing, truncated, undecodable or of another size.
        """
        try:
            image = decode(self.read_bytes(entry), self.camera_size, grey=grey)
        except ValueError as error:
            raise FrameError(self._where(entry), str(error)) from error
        return Shot(
            image, entry.role, entry.lasers_on, self.angle_deg(entry), entry.pose, entry.time_s,
            entry.exposure_us, entry.file,
        )  # fmt: skip

    def read_bytes(self, entry: FrameEntry) -> bytes:
        """The file of one frame, undecoded.

        Raises:
            FrameError: it cannot be read.
        """
        try:
            return (self.folder / entry.file).read_bytes()
        except OSError as error:
            raise FrameError(self._where(entry), reason(error)) from error

    def shots(self, *roles: Role, grey: bool = False, prefetch: int = 0) -> Iterator[Shot]:
        """Frames of these roles (all, where none is named), decoded as they are asked for.

        Args:
            roles: what is wanted.
            grey: luminance only.
            prefetch: how many frames a thread decodes ahead while the caller computes; 0 keeps one frame in
                memory.
        """
        return self.load_each(self.select(*roles), grey=grey, prefetch=prefetch)

    def load_each(
        self, entries: tuple[FrameEntry, ...], *, grey: bool = False, prefetch: int = 0
    ) -> Iterator[Shot]:
        """`shots` of a choice of entries."""
        if prefetch <= 0:
            for entry in entries:
                yield self.load(entry, grey=grey)
            return
        ahead: deque[Future[Shot]] = deque()
        pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix="decode")
        try:
            for entry in entries:
                ahead.append(pool.submit(self.load, entry, grey=grey))
                if len(ahead) > prefetch:
                    yield ahead.popleft().result()
            while ahead:
                yield ahead.popleft().result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)

    def _where(self, entry: FrameEntry) -> str:
        number = next((i for i, other in enumerate(self.entries) if other is entry), None)
        file = str(self.folder / entry.file)
        return file if number is None else f"{file} (frames[{number}])"


def _check_files(folder: Path, manifest: Manifest) -> None:
    """Every picture is there and, symbolic links followed, inside the folder."""
    home = folder.resolve()
    for number, entry in enumerate(manifest.frames):
        where = f"{folder / MANIFEST_FILE}: frames[{number}].file"
        try:
            target = (home / entry.file).resolve(strict=True)
        except (OSError, RuntimeError) as error:
            raise FrameError(where, f"{entry.file} is missing") from error
        if not target.is_relative_to(home):
            raise FrameError(where, f"{entry.file} is a link that leaves the folder of the recording")
        if not target.is_file():
            raise FrameError(where, f"{entry.file} is not a file")
