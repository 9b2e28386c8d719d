"""A capture that behaves as OpenCV's over V4L2 does, its silent failures included."""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np

from app.recording.picture import encode

MJPG, YUYV = cv2.VideoWriter.fourcc(*"MJPG"), cv2.VideoWriter.fourcc(*"YUYV")
_SIZES = ((320, 240), (640, 480))


@dataclass
class FakeWebcam:
    """The device behind captures.

    Attributes:
        formats: pixel formats that it has; the first is its own choice.
        properties: controls that it has, with their values.
        limits: lowest and highest value, beyond which a control silently stays at the end.
        makes_jpeg: how a picture becomes what MJPG sends.
        keeps_converting: as drivers that ignore the wish for undecoded pictures.
        stamp: gives the time stamp in seconds.
    """

    fps: float = 200.0
    formats: tuple[int, ...] = (YUYV, MJPG)
    properties: dict[int, float] = field(
        default_factory=lambda: {
            cv2.CAP_PROP_EXPOSURE: 156.0,
            cv2.CAP_PROP_AUTO_EXPOSURE: 3.0,
            cv2.CAP_PROP_GAIN: 0.0,
            cv2.CAP_PROP_WB_TEMPERATURE: 4600.0,
            cv2.CAP_PROP_AUTO_WB: 1.0,
            cv2.CAP_PROP_BRIGHTNESS: -1.0,
        }
    )
    limits: dict[int, tuple[float, float]] = field(
        default_factory=lambda: {cv2.CAP_PROP_EXPOSURE: (3.0, 2047.0), cv2.CAP_PROP_GAIN: (0.0, 255.0)}
    )
    makes_jpeg: Callable[[Any], bytes] = lambda image: encode(image, "jpeg")
    keeps_converting: bool = False
    stamp: Callable[[], float] = time.monotonic
    is_gone: bool = False
    is_busy: bool = False
    is_mute: bool = False
    opened: list[tuple[int | str, int]] = field(default_factory=list)
    writes: list[tuple[int, float]] = field(default_factory=list)
    hang: threading.Event = field(default_factory=threading.Event)

    def __post_init__(self) -> None:
        self.hang.set()

    def capture(self, target: int | str, api: int) -> "FakeCapture":
        self.opened.append((target, api))
        return FakeCapture(self)


class FakeCapture:
    def __init__(self, webcam: FakeWebcam) -> None:
        self._webcam = webcam
        self._is_open = not (webcam.is_gone or webcam.is_busy)
        webcam.is_busy = webcam.is_busy or self._is_open
        self._format, self._size, self._converts = webcam.formats[0], (640, 480), True
        self._wanted = [640, 480]
        self._number, self._stamp_s, self._next_s = 0, 0.0, time.monotonic()

    def isOpened(self) -> bool:  # noqa: N802 (OpenCV's name)
        return self._is_open

    def release(self) -> None:
        if self._is_open:
            self._webcam.is_busy = self._is_open = False

    def get(self, prop: int, /) -> float:
        if not self._is_open or self._webcam.is_gone:
            return -1.0
        known = {
            cv2.CAP_PROP_FOURCC: self._format,
            cv2.CAP_PROP_FRAME_WIDTH: self._size[0],
            cv2.CAP_PROP_FRAME_HEIGHT: self._size[1],
            cv2.CAP_PROP_FPS: self._webcam.fps,
            cv2.CAP_PROP_POS_MSEC: self._stamp_s * 1000.0,
        }
        return float(known.get(prop, self._webcam.properties.get(prop, -1.0)))

    def set(self, prop: int, value: float, /) -> bool:
        if not self._is_open or self._webcam.is_gone:
            return False
        if prop == cv2.CAP_PROP_FOURCC:
            # Says yes to what it does not have.
            if int(value) in self._webcam.formats:
                self._format = int(value)
            return True
        if prop in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT):
            self._wanted[prop == cv2.CAP_PROP_FRAME_HEIGHT] = int(value)
            self._size = min(_SIZES, key=lambda size: abs(size[0] - self._wanted[0]))
            return True
        if prop == cv2.CAP_PROP_CONVERT_RGB:
            self._converts = bool(value) or self._webcam.keeps_converting
            return True
        if prop in (cv2.CAP_PROP_FPS, cv2.CAP_PROP_BUFFERSIZE):
            return True
        if prop not in self._webcam.properties:
            return False
        self._webcam.writes.append((prop, value))
        lowest, highest = self._webcam.limits.get(prop, (-1e9, 1e9))
        self._webcam.properties[prop] = float(min(max(value, lowest), highest))
        return True

    def read(self) -> tuple[bool, Any]:
        self._webcam.hang.wait()
        if not self._is_open or self._webcam.is_gone or self._webcam.is_mute:
            return False, None
        time.sleep(max(0.0, self._next_s - time.monotonic()))
        self._next_s = max(self._next_s + 1.0 / self._webcam.fps, time.monotonic())
        self._number += 1
        self._stamp_s = self._webcam.stamp()
        rough = np.random.default_rng(self._number).integers(0, 256, (6, 8, 3), np.uint8)
        image = np.kron(rough, np.ones((self._size[1] // 6, self._size[0] // 8, 1), np.uint8))
        if self._converts:
            return True, image
        if self._format == MJPG:
            return True, np.frombuffer(self._webcam.makes_jpeg(image), np.uint8)[None, :]
        return True, image[:, :, :2]
