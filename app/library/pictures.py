"""The pictures of a scan, one by one: for a page that shows them, also while the scan is being taken."""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from app.errors import FrameError, NotThere, RecordingError
from app.recording.journal import JOURNAL_FILE, MANIFEST_FILE
from app.recording.manifest import FrameEntry
from app.recording.picture import ImageFormat, decode, encode
from app.recording.reader import Recording
from app.recording.shot import Role

_KEPT = 4
_QUALITY = 82
# What the thumbnail of a scan without a cloud shows best: an object in white light.
_SHOWN_FIRST = (Role.TEXTURE, Role.BACKGROUND)


def pictures_of(folder: Path) -> Recording:
    """The recording in the folder of a scan; read again only when it has changed.

    Raises:
        NotThere: it has no pictures.
        RecordingError: it is damaged.
    """
    for name in (JOURNAL_FILE, MANIFEST_FILE):
        try:
            facts = (folder / name).stat()
        except OSError:
            continue
        return _opened(folder, name, (facts.st_mtime_ns, facts.st_size, facts.st_ino))
    raise NotThere(f"The scan {folder.name!r} has no pictures.", "It holds clouds alone.")


def picture_file(recording: Recording, number: int) -> Path:
    """Where the picture of that number lies, counted from 0.

    Raises:
        NotThere: there are fewer.
        FrameError: it is gone, or leads out of the folder.
    """
    if not 0 <= number < len(recording.entries):
        count = len(recording.entries)
        raise NotThere(f"The scan {recording.folder.name!r} has no picture {number}.", f"It has {count}.")
    entry = recording.entries[number]
    home = recording.folder.resolve()
    path = (home / entry.file).resolve()
    if not path.is_relative_to(home) or not path.is_file():
        raise FrameError(f"frames[{number}].file", f"{entry.file} is missing")
    return path


def middle_picture(recording: Recording) -> int:
    """Number of the picture that stands for a scan without a cloud.

    Raises:
        NotThere: it has none.
    """
    if not recording.entries:
        raise NotThere(f"The scan {recording.folder.name!r} has no pictures.", "Scan again.")
    for role in _SHOWN_FIRST:
        of_role = [number for number, entry in enumerate(recording.entries) if entry.role is role]
        if of_role:
            return of_role[len(of_role) // 2]
    return len(recording.entries) // 2


def numbered(recording: Recording, roles: Sequence[Role]) -> list[tuple[int, FrameEntry]]:
    """Entries of these roles with their numbers; of all, where none is named."""
    return [
        (number, entry)
        for number, entry in enumerate(recording.entries)
        if not roles or entry.role in roles
    ]  # fmt: skip


def small_picture(recording: Recording, number: int, width: int, kind: ImageFormat = "jpeg") -> bytes:
    """A picture no wider than that, as the file of a picture.

    Raises:
        NotThere, FrameError: see `picture_file`; or it cannot be decoded.
    """
    path = picture_file(recording, number)
    try:
        image = decode(path.read_bytes(), recording.camera_size)
    except (OSError, ValueError) as error:
        raise FrameError(f"frames[{number}].file", f"{path.name} {error}") from error
    height = max(1, round(image.shape[0] * width / image.shape[1]))
    if width < image.shape[1]:
        image = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA).astype(np.uint8)
    return encode(image, kind, _QUALITY)


@lru_cache(maxsize=_KEPT)
def _opened(folder: Path, name: str, facts: tuple[int, int, int]) -> Recording:
    try:
        return Recording.open(folder)
    except RecordingError as error:
        # The journal goes away when the recording is closed: what was asked for is in the manifest then.
        if name == JOURNAL_FILE and not (folder / name).exists():
            return Recording.open(folder)
        raise error
