"""What a source of pictures holds, found out in one pass that keeps a stamp-sized copy of each."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats
from app.vision.stripe import Image

Progress: TypeAlias = Callable[[int, int | None], None]
"""Called with how many are done, and of how many (None where unknown)."""

THUMBNAIL = (32, 24)


@dataclass(frozen=True, slots=True)
class Skipped:
    """A picture that could not be used.

    Attributes:
        name: the file, or the frame of a video.
        problem: as a predicate, such as `is truncated`.
    """

    name: str
    problem: str

    def __str__(self) -> str:
        return f"{self.name} {self.problem}"


@dataclass(frozen=True, eq=False, slots=True)
class Survey:
    """The usable pictures of a source, in order.

    Attributes:
        size: width and height, the same for all.
        indices: (K,) how the source itself finds each picture again.
        places: (K,) number of each in an even sequence, from 0; a picture that was lost leaves a gap.
        count: length of that sequence.
        times_s: (K,) when each was taken, NaN where the source does not say.
        thumbnails: (K, 24, 32) uint8.
        skipped: what could not be used.
        repeated: how many frames only repeated the one before them, and are not among the pictures.
        stride: frames of a padded video for each picture of the camera, to a fraction; 1 elsewhere.
        is_steady: the pictures are of a table that never stopped, as in a video.
    """

    size: tuple[int, int]
    indices: NDArray[np.intp]
    places: NDArray[np.intp]
    count: int
    times_s: Floats
    thumbnails: NDArray[np.uint8]
    skipped: tuple[Skipped, ...]
    repeated: int
    stride: float
    is_steady: bool

    def __len__(self) -> int:
        return len(self.indices)

    def even_thumbnails(self, every: int = 1) -> NDArray[np.uint8]:
        """Thumbnails of every so many places, a gap filled with the picture before it."""
        wanted = np.arange(0, self.count, every)
        newest = np.searchsorted(self.places, wanted, side="right") - 1
        return self.thumbnails[np.maximum(newest, 0)]


class PictureSource(Protocol):
    """A folder of pictures, or a video."""

    @property
    def name(self) -> str: ...

    def survey(self, progress: Progress) -> Survey:
        """Look at every picture once."""
        ...

    def read(self, indices: Sequence[int]) -> Iterator[bytes]:
        """PNG or JPEG files of some pictures, in rising order of their indices, one in memory at a time."""
        ...


def thumbnail(image: Image) -> NDArray[np.uint8]:
    """(24, 32) grey."""
    small = cv2.resize(image, THUMBNAIL, interpolation=cv2.INTER_AREA)
    grey = small if small.ndim == 2 else cv2.cvtColor(small, cv2.COLOR_BGR2GRAY)
    return grey.astype(np.uint8, copy=False)
