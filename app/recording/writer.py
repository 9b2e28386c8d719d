"""A recording as it grows: each frame is safe on disk, and noted, before the next one comes."""

import contextlib
import errno
import os
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Self

from app.documents import Json, compose
from app.errors import OutputError, RecordingError
from app.files import make_folder, reason, write_whole
from app.locks import is_locked, lock
from app.recording.journal import JOURNAL_FILE, MANIFEST_FILE, journal_line
from app.recording.manifest import FrameEntry, Header, Manifest, check_frame
from app.recording.picture import ImageFormat, encode, inspect
from app.recording.reader import Recording
from app.recording.shot import Role, Shot

FRAMES_FOLDER = "frames"
_TAKEN_HINT = "Name a new or empty folder, or add to the recording that is there."
_BUSY_HINT = "Wait until the scan has ended, or stop it."
# Whoever only asks holds the lock for a moment.
_LOCK_PATIENCE_S = 1.0


class RecordingWriter:
    """Writes frames and a journal; `close` turns the journal into `recording.json`.

    It holds a lock on its journal: that is how others know that the recording is being written.

    As a context manager it closes when the block ends well. When it does not, the journal stays: the frames
    taken so far can be read with `Recording.open`, gone on with by `resume`, or thrown away by `discard`.

    Attributes:
        folder: where the recording lies.
        header: what it says once.
        entries: the frames so far.
    """

    def __init__(
        self,
        folder: Path,
        header: Header,
        entries: tuple[FrameEntry, ...],
        image_format: ImageFormat,
        quality: int,
    ) -> None:
        self.folder, self.header, self.entries = folder, header, list(entries)
        self._format, self._quality = image_format, quality
        self._count_before = len(entries)
        self._made: list[Path] = []
        self._number = len(entries)
        self._journal = self._start_journal()

    @classmethod
    def create(
        cls, path: Path | str, header: Header, *, image_format: ImageFormat = "png", quality: int = 95
    ) -> Self:
        """Start a recording in a folder that is new or empty.

        Args:
            path: the folder; it is made, with those above it.
            header: see `Header.of`.
            image_format: of frames given as arrays.
            quality: of JPEG frames, 1..100.

        Raises:
            OutputError: the folder holds something, or cannot be made.
        """
        folder = Path(path)
        refuse_taken(folder)
        make_folder(folder / FRAMES_FOLDER)
        return cls(folder, header, (), image_format, quality)

    @classmethod
    def resume(
        cls,
        path: Path | str,
        header: Header | None = None,
        *,
        image_format: ImageFormat = "png",
        quality: int = 95,
    ) -> Self:
        """Go on with a recording, whether it was closed or interrupted.

        Args:
            path: its folder.
            header: takes the place of the header that is there.
            image_format: of frames given as arrays.
            quality: of JPEG frames, 1..100.

        Raises:
            RecordingError: what is there cannot be read, or the header does not fit its frames.
            OutputError: the folder cannot be written.
        """
        there = Recording.open(path)
        header = header or _header_of(there.manifest)
        _manifest_of(header, there.entries, str(there.folder))
        make_folder(there.folder / FRAMES_FOLDER)
        writer = cls(there.folder, header, there.entries, image_format, quality)
        # Begun by a program that was killed; nobody else writes here now.
        for begun in (there.folder / FRAMES_FOLDER).glob(".*.part"):
            begun.unlink(missing_ok=True)
        return writer

    def append(self, shot: Shot) -> FrameEntry:
        """Write one frame; it is on disk and noted when this returns.

        Raises:
            RecordingError: the shot does not fit the recording.
            OutputError: it cannot be written; the recording is as it was before.
        """
        size = (shot.image.shape[1], shot.image.shape[0])
        self._check_size(size)
        return self._append(
            encode(shot.image, self._format, self._quality), ".png" if self._format == "png" else ".jpg",
            shot.role, shot.lasers_on, shot.angle_deg, shot.pose, shot.time_s, shot.exposure_us, {},
        )  # fmt: skip

    def append_encoded(
        self,
        data: bytes,
        role: Role,
        lasers_on: tuple[str, ...] = (),
        angle_deg: float | None = None,
        *,
        pose: int | None = None,
        time_s: float | None = None,
        exposure_us: float | None = None,
        extra: Mapping[str, Any] | None = None,
    ) -> FrameEntry:
        """Write one frame that is a PNG or JPEG file already, byte for byte: a camera's own, for instance.

        Args:
            data: the file.
            role, lasers_on, angle_deg, pose, time_s, exposure_us: as in `Shot`.
            extra: further keys to keep with the entry.

        Raises:
            RecordingError: the picture or its facts do not fit the recording.
            OutputError: as `append`.
        """
        try:
            facts = inspect(data)
        except ValueError as error:
            raise RecordingError(self._next_place(), f"the picture {error}") from error
        self._check_size(facts.size)
        return self._append(
            data, facts.suffix, role, lasers_on, angle_deg, pose, time_s, exposure_us, extra or {}
        )

    def close(self) -> Recording:
        """Write `recording.json` and drop the journal; the finished recording.

        Raises:
            OutputError: it cannot be written; the journal stays.
        """
        manifest = _manifest_of(self.header, tuple(self.entries), str(self.folder))
        write_whole(self.folder / MANIFEST_FILE, manifest.text().encode())
        self._journal.close()
        with contextlib.suppress(OSError):
            (self.folder / JOURNAL_FILE).unlink(missing_ok=True)
        return Recording(self.folder, manifest)

    def suspend(self) -> None:
        """Let go of the files and leave the journal, so that `resume` can go on."""
        self._journal.close()

    def discard(self) -> None:
        """Take back everything this writer wrote; what was there before it stays."""
        self._journal.close()
        for path in self._made:
            path.unlink(missing_ok=True)
        if self._count_before == 0 and not (self.folder / MANIFEST_FILE).exists():
            (self.folder / JOURNAL_FILE).unlink(missing_ok=True)
            for folder in (self.folder / FRAMES_FOLDER, self.folder):
                with contextlib.suppress(OSError):
                    folder.rmdir()
        elif (self.folder / MANIFEST_FILE).exists():
            (self.folder / JOURNAL_FILE).unlink(missing_ok=True)
        else:
            self.entries = self.entries[: self._count_before]
            self._start_journal().close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self.close()
        else:
            self.suspend()

    def _append(
        self,
        data: bytes,
        suffix: str,
        role: Role,
        lasers_on: tuple[str, ...],
        angle_deg: float | None,
        pose: int | None,
        time_s: float | None,
        exposure_us: float | None,
        extra: Mapping[str, Any],
    ) -> FrameEntry:
        path = self._free_name(suffix)
        facts: Json = {**extra, "file": path.relative_to(self.folder).as_posix(), "role": role.value}
        given = {"pose": pose, "angle_deg": angle_deg, "time_s": time_s, "exposure_us": exposure_us}
        facts |= {key: value for key, value in given.items() if value is not None}
        facts["lasers_on"] = list(lasers_on)
        entry = compose(FrameEntry, facts, self._next_place(), RecordingError)
        try:
            check_frame(self.header, entry, "frame")
        except ValueError as error:
            raise RecordingError(self._next_place(), str(error)) from error
        write_whole(path, data, is_durable=False)
        self._made.append(path)
        try:
            self._note(journal_line(entry))
        except OutputError:
            path.unlink(missing_ok=True)
            raise
        self.entries.append(entry)
        return entry

    def _free_name(self, suffix: str) -> Path:
        while True:
            path = self.folder / FRAMES_FOLDER / f"{self._number:06d}{suffix}"
            self._number += 1
            if not path.exists():
                return path

    def _note(self, line: bytes) -> None:
        """Add a line to the journal, or leave the journal as it is."""
        before = self._journal.tell()
        try:
            if self._journal.write(line) != len(line):
                # A disk that fills up takes a part of it, and complains the next time only.
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError as error:
            with contextlib.suppress(OSError):
                self._journal.truncate(before)
                self._journal.seek(before)
            raise OutputError(str(self.folder / JOURNAL_FILE), reason(error)) from error

    def _start_journal(self) -> BinaryIO:
        """The journal with everything that is known, whole from the first moment, open at its end."""
        path = self.folder / JOURNAL_FILE
        if is_locked(path):
            raise self._busy()
        write_whole(path, b"".join(journal_line(entry) for entry in (self.header, *self.entries)))
        try:
            # Unbuffered: what cannot be written must not come back with a later line.
            journal = path.open("r+b", buffering=0)
            journal.seek(0, 2)
        except OSError as error:
            raise OutputError(str(path), reason(error)) from error
        if not lock(journal, _LOCK_PATIENCE_S):
            journal.close()
            raise self._busy()
        return journal

    def _busy(self) -> OutputError:
        return OutputError(str(self.folder), "is being written by another program", _BUSY_HINT)

    def _check_size(self, size: tuple[int, int]) -> None:
        if size != self.header.camera_size:
            width, height = self.header.camera_size
            raise RecordingError(
                self._next_place(), f"the picture is {size[0]} x {size[1]} pixels, not {width} x {height}"
            )

    def _next_place(self) -> str:
        return f"{self.folder}: frame {len(self.entries)}"


def refuse_taken(folder: Path) -> None:
    """Whether a new recording may be made there.

    Raises:
        OutputError: the folder holds something, or is none.
    """
    try:
        is_taken = folder.exists() and (not folder.is_dir() or any(folder.iterdir()))
    except OSError as error:
        raise OutputError(str(folder), reason(error)) from error
    if is_taken:
        problem = "is not empty" if folder.is_dir() else "is not a folder"
        raise OutputError(str(folder), problem, _TAKEN_HINT)


def _header_of(manifest: Manifest) -> Header:
    document = manifest.as_json()
    del document["frames"]
    return compose(Header, document, MANIFEST_FILE, RecordingError)


def _manifest_of(header: Header, entries: tuple[FrameEntry, ...], where: str) -> Manifest:
    document = {**header.as_json(), "frames": [entry.as_json() for entry in entries]}
    return compose(Manifest, document, where, RecordingError)
