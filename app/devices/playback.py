"""Pictures that were taken before, handed out one after the other or to fit where the table stands."""

import itertools
import math
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np

from app.devices.camera_driver import Picture
from app.devices.opencv_quiet import opencv_quiet
from app.recording.manifest import FrameEntry
from app.recording.picture_folder import PictureFolder
from app.recording.reader import Recording
from app.recording.shot import Role


class Roll(Protocol):
    """Pictures in a fixed order."""

    def __len__(self) -> int: ...

    def picture(self, number: int) -> Picture:
        """One of them.

        Raises:
            OSError: it is not there any more.
            ScannerError: it cannot be read.
        """
        ...


class RecordedRoll:
    """The frames of a recording.

    Args:
        recording: open.
        role: only frames of this one; None for all.
    """

    def __init__(self, recording: Recording, role: Role | None) -> None:
        self.recording = recording
        self.entries = recording.entries if role is None else recording.select(role)
        self._angles_deg = [recording.angle_deg(entry) for entry in self.entries]

    def __len__(self) -> int:
        return len(self.entries)

    def picture(self, number: int) -> Picture:
        return self.recording.read_bytes(self.entries[number])

    def nearest(self, angle_deg: float, lasers: tuple[str, ...]) -> int:
        """Number of the frame taken with these lasers on, or as few others as possible, nearest to the angle.

        A frame that tells no angle is taken only where none tells one.
        """
        lit = frozenset(lasers)
        return min(
            range(len(self.entries)),
            key=lambda number: (
                len(lit.symmetric_difference(self.entries[number].lasers_on)),
                _between_deg(self._angles_deg[number], angle_deg),
                number,
            ),
        )

    def entry(self, number: int) -> FrameEntry:
        return self.entries[number]


class FolderRoll:
    """The pictures of a folder by their names, 2 before 10."""

    def __init__(self, folder: Path) -> None:
        self._pictures = PictureFolder(folder)

    def __len__(self) -> int:
        return len(self._pictures.files)

    def picture(self, number: int) -> Picture:
        return next(iter(self._pictures.read([number])))


class VideoRoll:
    """The frames of a video, to be asked for in order, or from the first again.

    Raises:
        ValueError: it is no video that can be read; a predicate.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._open()
        count = sum(1 for _ in itertools.takewhile(bool, iter(self._capture.grab, None)))
        if not count:
            raise ValueError("is not a video that can be read")
        self._count = count

    def __len__(self) -> int:
        return self._count

    def picture(self, number: int) -> Picture:
        if number < self._following or number == 0:
            self._capture.release()
            self._open()
        while self._following < number:
            self._capture.grab()
            self._following += 1
        is_read, picture = self._capture.read()
        self._following += 1
        if not is_read:
            raise FileNotFoundError(self._path)
        return np.asarray(picture, np.uint8)

    def _open(self) -> None:
        with opencv_quiet():
            self._capture = cv2.VideoCapture(str(self._path), cv2.CAP_FFMPEG)
        self._capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
        self._following = 0


def _between_deg(one: float | None, other: float) -> float:
    """Angle between two directions, 0..180; infinite for one that is unknown."""
    return math.inf if one is None else abs((one - other + 180.0) % 360.0 - 180.0)
