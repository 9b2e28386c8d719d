"""Views that are left out: struck out by a person, or because they do not fit the others. None is deleted."""

import json
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Self

from pydantic import Field

from app.documents import Entry, read_document
from app.errors import RecordingError
from app.files import write_whole
from app.recording.reader import Recording
from app.recording.shot import Role

STRUCK_FILE = "struck.json"
BY_HAND = "struck out by hand"


class _Document(Entry):
    struck: dict[str, str] = Field(default_factory=dict)
    wanted: tuple[int, ...] = ()


class Struck:
    """Numbers of views in one recording that are left out, and why. Safe from several threads.

    The number of a view is that of its first entry in the recording. Written to disk at every change.

    Args:
        folder: of the recording; the file appears in it with the first change.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / STRUCK_FILE
        self._lock = threading.Lock()
        self._reasons: dict[int, str] = {}
        self._wanted: set[int] = set()

    @classmethod
    def load(cls, folder: Path) -> Self:
        """As it was left.

        Raises:
            RecordingError: the file cannot be read.
        """
        struck = cls(folder)
        if struck._path.is_file():
            document = read_document(struck._path, _Document, RecordingError)
            try:
                struck._reasons = {int(number): why for number, why in document.struck.items()}
            except ValueError as error:
                raise RecordingError(str(struck._path), "names something that is no number") from error
            struck._wanted = set(document.wanted)
        return struck

    @property
    def reasons(self) -> Mapping[int, str]:
        """Why each is left out, by number."""
        with self._lock:
            return dict(self._reasons)

    def strike(self, number: int, why: str = BY_HAND) -> None:
        """Leave a view out. Raises OutputError."""
        with self._lock:
            self._reasons[number] = why
            self._wanted.discard(number)
            self._save()

    def strike_bad(self, reasons: Mapping[int, str]) -> None:
        """Leave out what does not fit, except what a person has taken back. Raises OutputError."""
        with self._lock:
            new = {n: why for n, why in reasons.items() if n not in self._wanted and n not in self._reasons}
            if new:
                self._reasons |= new
                self._save()

    def take_back(self, number: int) -> None:
        """Use it after all. Raises OutputError."""
        with self._lock:
            self._reasons.pop(number, None)
            self._wanted.add(number)
            self._save()

    def kept(self, recording: Recording) -> Recording:
        """The recording without the views that are left out, with all their pictures."""
        entries = recording.entries
        out = set(self.reasons)
        stops = {(e.pose, e.angle_deg) for n, e in enumerate(entries) if n in out and e.role is Role.AXIS}
        poses = {e.pose for n, e in enumerate(entries) if n in out and e.role is Role.LASER_PLANE}
        frames = tuple(
            entry
            for number, entry in enumerate(entries)
            if number not in out
            and not (entry.role is Role.AXIS and (entry.pose, entry.angle_deg) in stops)
            and not (entry.role is Role.LASER_PLANE and entry.pose in poses)
        )
        return Recording(recording.folder, recording.manifest.model_copy(update={"frames": frames}))

    def _save(self) -> None:
        document = {
            "struck": {str(number): why for number, why in sorted(self._reasons.items())},
            "wanted": sorted(self._wanted),
        }
        write_whole(self._path, json.dumps(document, indent=1).encode() + b"\n")
