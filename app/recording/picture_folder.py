"""A folder of pictures as a source."""

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Literal, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from app.errors import FrameError, ImportFailed
from app.files import reason
from app.recording.picture import decode, encode, inspect
from app.recording.survey import Progress, Skipped, Survey, thumbnail
from app.vision.stripe import Image

Order: TypeAlias = Literal["name", "time"]

_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".pgm", ".ppm"})


class PictureFolder:
    """Pictures in the order of their names (2 before 10) or of the time they were last changed.

    PNG and JPEG files are handed on byte for byte, others as PNG.
    """

    def __init__(self, folder: Path, order: Order = "name") -> None:
        self.folder = folder
        try:
            files = [p for p in folder.iterdir() if p.suffix.lower() in _SUFFIXES and p.is_file()]
            if order == "time":
                files.sort(key=lambda path: (path.stat().st_mtime_ns, natural(path.name)))
            else:
                files.sort(key=lambda path: natural(path.name))
        except OSError as error:
            raise ImportFailed(f"{folder}: {reason(error)}") from error
        if not files:
            raise ImportFailed(f"{folder} holds no picture.")
        self.files = files

    @property
    def name(self) -> str:
        return self.folder.name or str(self.folder)

    def survey(self, progress: Progress) -> Survey:
        sizes: dict[int, tuple[int, int]] = {}
        thumbnails: dict[int, NDArray[np.uint8]] = {}
        problems: dict[int, str] = {}
        for index, path in enumerate(self.files):
            try:
                image = _grey(path.read_bytes())
            except (ValueError, OSError) as error:
                problems[index] = reason(error) if isinstance(error, OSError) else str(error)
            else:
                sizes[index], thumbnails[index] = (image.shape[1], image.shape[0]), thumbnail(image)
            progress(index + 1, len(self.files))
        if not sizes:
            raise ImportFailed(f"{self.folder}: not one of {len(self.files)} pictures can be decoded.")
        size = Counter(sizes.values()).most_common(1)[0][0]
        for index, other in sizes.items():
            if other != size:
                problems[index] = (
                    f"is {other[0]} x {other[1]} pixels, not {size[0]} x {size[1]} as the others"
                )
        good = np.array([index for index in sizes if index not in problems], np.intp)
        return Survey(
            size=size,
            indices=good,
            places=good,
            count=len(self.files),
            times_s=np.full(len(good), np.nan),
            thumbnails=np.stack([thumbnails[index] for index in good.tolist()]),
            skipped=tuple(Skipped(self.files[i].name, problems[i]) for i in sorted(problems)),
            repeated=0,
            stride=1.0,
            is_steady=False,
        )

    def read(self, indices: Sequence[int]) -> Iterator[bytes]:
        for index in indices:
            path = self.files[index]
            try:
                data = path.read_bytes()
                yield data if _is_kept_as_it_is(data) else encode(_decode_other(data))
            except OSError as error:
                raise FrameError(str(path), reason(error)) from error
            except ValueError as error:
                raise FrameError(str(path), str(error)) from error


def natural(name: str) -> tuple[tuple[int, str], ...]:
    """Sorts numbers in names by value."""
    parts = re.split(r"(\d+)", name.lower())
    return tuple((int(part), "") if number % 2 else (0, part) for number, part in enumerate(parts))


def _is_kept_as_it_is(data: bytes) -> bool:
    return data.startswith((b"\x89PNG", b"\xff\xd8"))


def _grey(data: bytes) -> Image:
    if _is_kept_as_it_is(data):
        return decode(data, inspect(data).size, grey=True)
    return _decode_other(data)


def _decode_other(data: bytes) -> Image:
    if not data:
        raise ValueError("is empty")
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error as error:
        raise ValueError("cannot be decoded") from error
    if image is None:
        raise ValueError("cannot be decoded")
    return image.astype(np.uint8, copy=False)
