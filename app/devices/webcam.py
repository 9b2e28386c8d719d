"""A webcam that OpenCV has opened: what comes, whether as JPEG or as pixels, and when it was exposed."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from app.devices.camera_driver import CameraFacts, Control, ControlName, RawFrame
from app.devices.capture_controls import Capture, CaptureControls
from app.devices.jpeg import whole_jpeg
from app.errors import DeviceLost, DeviceUnrecognised
from app.recording.picture import inspect
from app.vision.stripe import Image

_FIRST_PICTURE_S = 5.0
# So many empty reads in a row, and the camera is given up.
_MOST_EMPTY = 5
_MOST_DAMAGED = 10
_EMPTY_PAUSE_S = 0.01
# A time stamp of the monotonic clock is no older than this when its picture arrives.
_OLDEST_S = 1.0
_MJPG = cv2.VideoWriter.fourcc(*"MJPG")


@dataclass(slots=True)
class Webcam:
    """An open capture; used by its reading thread alone."""

    name: str
    capture: Capture
    knobs: CaptureControls
    facts: CameraFacts
    empty: int = 0

    def begin(self) -> None:
        """Let the camera's own JPEG through where it has any, and learn from a picture what really comes."""
        if int(self.capture.get(cv2.CAP_PROP_FOURCC)) == _MJPG:
            self.capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
            data = self._first_jpeg()
            if data is not None:
                self._learn(inspect(data).size, True)
                return
            self.capture.set(cv2.CAP_PROP_CONVERT_RGB, 1)
        picture = self._first()
        if picture.ndim not in (2, 3) or min(picture.shape[:2]) < 2:
            raise DeviceUnrecognised(self.name, "sends pictures in a format that cannot be read")
        self._learn((picture.shape[1], picture.shape[0]), False)

    def read(self) -> RawFrame | None:
        picture = self._picture()
        arrived_s = time.monotonic()
        if picture is None:
            self.empty += 1
            if self.empty >= _MOST_EMPTY or not _is_there(self.facts.place):
                raise DeviceLost(self.name, "sends no more pictures")
            time.sleep(_EMPTY_PAUSE_S)
            return None
        self.empty = 0
        exposure_us = self.knobs.exposure_us
        exposed_s = self._exposed_s(arrived_s, exposure_us) if self.facts.has_timestamps else None
        if not self.facts.gives_jpeg:
            return RawFrame(picture, exposed_s, exposure_us)
        return RawFrame(_jpeg_of(picture) or picture.tobytes(), exposed_s, exposure_us)

    def controls(self) -> Mapping[ControlName, Control]:
        return self.knobs.read()

    def set_control(self, name: ControlName, value: float | None) -> Control:
        return self.knobs.write(name, value)

    def interrupt(self) -> None:
        """OpenCV cannot be interrupted."""

    def close(self) -> None:
        self.capture.release()

    def _picture(self) -> Image | None:
        """What OpenCV read; it raises where it cannot undo a format that it was asked not to decode."""
        try:
            is_read, picture = self.capture.read()
        except cv2.error:
            return None
        return np.asarray(picture, np.uint8) if is_read and picture is not None and picture.size else None

    def _first_jpeg(self) -> bytes | None:
        """None where OpenCV decodes all the same. Cameras may begin with a few that are damaged."""
        for _ in range(_MOST_DAMAGED):
            picture = self._picture()
            if picture is None:
                time.sleep(_EMPTY_PAUSE_S)
            elif picture.size != max(picture.shape):
                return None
            elif (data := _jpeg_of(picture)) is not None:
                return data
        return None

    def _first(self) -> Image:
        deadline_s = time.monotonic() + _FIRST_PICTURE_S
        while True:
            picture = self._picture()
            if picture is not None:
                return picture
            if time.monotonic() > deadline_s:
                raise DeviceUnrecognised(
                    self.name,
                    "opens, but sends no picture",
                    "Try another USB socket, a smaller size or rate, or fourcc YUYV.",
                )
            time.sleep(_EMPTY_PAUSE_S)

    def _learn(self, size: tuple[int, int], gives_jpeg: bool) -> None:
        stamp_s = self.capture.get(cv2.CAP_PROP_POS_MSEC) / 1000.0
        has_timestamps = 0.0 <= time.monotonic() - stamp_s < _OLDEST_S
        self.facts = replace(self.facts, size=size, has_timestamps=has_timestamps, gives_jpeg=gives_jpeg)

    def _exposed_s(self, arrived_s: float, exposure_us: float | None) -> float | None:
        """The kernel stamps a picture when its first line is sent, and that is when it has been exposed.

        An exposure that is not known has lasted one period at most.
        """
        stamp_s = self.capture.get(cv2.CAP_PROP_POS_MSEC) / 1000.0
        if not 0.0 <= arrived_s - stamp_s < _OLDEST_S:
            return None
        return stamp_s - (1.0 / self.facts.fps if exposure_us is None else exposure_us / 1e6)


def _is_there(place: str) -> bool:
    return not place.startswith("/") or Path(place).exists()


def _jpeg_of(picture: Image) -> bytes | None:
    """The JPEG that an array of bytes holds; None where it holds none."""
    try:
        return whole_jpeg(picture.tobytes())
    except ValueError:
        return None
