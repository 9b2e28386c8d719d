"""A video file as a source.

FFmpeg (in OpenCV) passes over frames that do not decode without a word. They are found out by their times:
a lost frame leaves a hole in the even rhythm of the others.
"""

import math
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from app.errors import ImportFailed
from app.geometry.arrays import Floats
from app.recording.padding import find_padding
from app.recording.picture import ImageFormat, encode
from app.recording.survey import Progress, Skipped, Survey, thumbnail
from app.vision.stripe import Image

_COMPARED = (160, 120)
_MOST_NAMED = 1000
_NO_VIDEO_HINT = "Name a video file that FFmpeg can play, or a folder of pictures."
_REPORT_EVERY = 16


class Video:
    """Frames of a video that are pictures of their own, as stored: rotation tags are ignored."""

    def __init__(self, path: Path, image_format: ImageFormat = "png", quality: int = 95) -> None:
        self.path, self._format, self._quality = path, image_format, quality

    @property
    def name(self) -> str:
        return self.path.name

    def survey(self, progress: Progress) -> Survey:
        times_s: list[float] = []
        changes: list[float] = []
        thumbnails: list[NDArray[np.uint8]] = []
        size, before = (0, 0), np.zeros(_COMPARED[::-1], np.float32)
        with self._opened() as capture:
            announced = max(0, int(capture.get(cv2.CAP_PROP_FRAME_COUNT)))
            rate = float(capture.get(cv2.CAP_PROP_FPS))
            for image in _frames(capture):
                times_s.append(float(capture.get(cv2.CAP_PROP_POS_MSEC)) / 1000.0)
                size = (image.shape[1], image.shape[0])
                small = cv2.resize(image, _COMPARED, interpolation=cv2.INTER_AREA).astype(
                    np.uint8, copy=False
                )
                grey = cv2.cvtColor(small, cv2.COLOR_BGR2GRAY).astype(np.float32)
                changes.append(float(cv2.norm(grey, before, cv2.NORM_L1)) / grey.size)
                before = grey
                thumbnails.append(thumbnail(small))
                if len(times_s) % _REPORT_EVERY == 0:
                    progress(len(times_s), max(announced, len(times_s)) or None)
        if not times_s:
            raise ImportFailed(f"{self.path}: not one frame decodes.", _NO_VIDEO_HINT)
        progress(len(times_s), len(times_s))
        numbers = _frame_numbers(np.array(times_s), rate)
        padding = find_padding(np.array(changes), numbers)
        return Survey(
            size=size,
            indices=padding.kept,
            places=padding.ordinals,
            count=int(padding.ordinals[-1]) + 1,
            times_s=numbers[padding.kept] / rate if rate > 0.0 else np.full(len(padding.kept), np.nan),
            thumbnails=np.stack([thumbnails[index] for index in padding.kept.tolist()]),
            skipped=self._lost(numbers, announced),
            repeated=len(times_s) - len(padding.kept),
            stride=padding.stride,
            is_steady=True,
        )

    def read(self, indices: Sequence[int]) -> Iterator[bytes]:
        wanted = iter(indices)
        following = next(wanted, None)
        with self._opened() as capture:
            for index, image in enumerate(_frames(capture)):
                if following is None:
                    return
                if index == following:
                    yield encode(image, self._format, self._quality)
                    following = next(wanted, None)

    def _lost(self, numbers: NDArray[np.intp], announced: int) -> tuple[Skipped, ...]:
        """Frames that the file announces and that never came out, by number from 0."""
        everything = max(announced, int(numbers[-1]) + 1)
        lost = np.setdiff1d(np.arange(everything), numbers)
        return tuple(
            Skipped(f"{self.name} frame {n}", "does not decode") for n in lost[:_MOST_NAMED].tolist()
        )

    @contextmanager
    def _opened(self) -> Iterator[cv2.VideoCapture]:
        # What FFmpeg would print on the terminal is told by `Survey.skipped`.
        os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
        if not self.path.is_file():
            raise ImportFailed(f"{self.path}: no such file.")
        capture = cv2.VideoCapture(str(self.path), cv2.CAP_FFMPEG)
        try:
            if not capture.isOpened():
                raise ImportFailed(f"{self.path} is not a video that can be read.", _NO_VIDEO_HINT)
            capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
            yield capture
        finally:
            capture.release()


def _frames(capture: cv2.VideoCapture) -> Iterator[Image]:
    while True:
        is_read, image = capture.read()
        if not is_read:
            return
        yield image.astype(np.uint8, copy=False)


def _frame_numbers(times_s: Floats, rate: float) -> NDArray[np.intp]:
    """Number of each frame by its time; simply counted where the times are not those of an even rhythm."""
    counted = np.arange(len(times_s))
    if not (math.isfinite(rate) and rate > 0.0):
        return counted
    numbers: NDArray[np.intp] = np.round((times_s - times_s[0]) * rate).astype(np.intp)
    is_even = bool(np.all(np.diff(numbers) > 0)) and numbers[-1] <= 1.5 * len(times_s)
    return numbers if is_even else counted
