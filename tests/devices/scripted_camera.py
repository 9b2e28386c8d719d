"""A camera that does what a test tells it, in real time but fast."""

import threading
import time
from collections.abc import Callable, Mapping

import numpy as np

from app.devices.camera_controls import lacks
from app.devices.camera_driver import CameraFacts, Control, ControlName, Picture, RawFrame
from app.errors import DeviceError, DeviceLost, DeviceNotFound, DeviceTimeout
from app.recording.picture import encode
from app.vision.stripe import Image

SIZE = (64, 48)


def noise_picture(number: int, size: tuple[int, int] = SIZE) -> Image:
    """A colour picture that no other number gives."""
    return np.random.default_rng(number).integers(0, 256, (size[1], size[0], 3), np.uint8)


class ScriptedCamera:
    """Pictures at a steady rate, and faults on demand.

    Attributes:
        picture: makes the data of a picture from its number.
        is_frozen, is_stuck: it sends nothing; it sends the same picture for ever.
        is_gone: as if unplugged.
        late_s: how long a control takes to work.
        delay_s: from exposure to arrival; frames that are under way are those of the past.
        written: every control that was set, in order.
        exposures: when each picture's exposure began and the exposure control it was taken with.
    """

    def __init__(self, *, fps: float = 200.0, is_timed: bool = False, delay_s: float = 0.0) -> None:
        self.fps, self.is_timed, self.delay_s = fps, is_timed, delay_s
        self.size, self.late_s = SIZE, 0.0
        self.picture: Callable[[int], Picture] = noise_picture
        self.is_frozen = self.is_stuck = self.is_gone = False
        self.breaks_with: Exception | None = None
        self.written: list[tuple[ControlName, float | None]] = []
        self.exposures: list[tuple[float, float | None]] = []
        self.opened = 0
        self.numbers: list[int] = []
        self._values: dict[ControlName, float | None] = {}
        self._history: list[tuple[float, float | None]] = []
        self._number = 0
        self._next_s = 0.0
        self._is_open = False
        self._lock = threading.Lock()

    @property
    def facts(self) -> CameraFacts:
        return CameraFacts("Scripted", "nowhere", self.size, self.fps, self.is_timed, False)

    def connect(self) -> None:
        if self.is_gone:
            raise DeviceNotFound("scripted", "is not there")
        self.opened += 1
        self._is_open = True
        self._values = {ControlName.EXPOSURE: None, ControlName.GAIN: 1.0}
        self._next_s = time.monotonic()

    def disconnect(self) -> None:
        self._is_open = False

    def grab(self, timeout_s: float) -> RawFrame:
        deadline_s = time.monotonic() + timeout_s
        while True:
            if self.breaks_with is not None:
                error, self.breaks_with = self.breaks_with, None
                raise error
            if self.is_gone or not self._is_open:
                raise DeviceLost("scripted", "is unplugged")
            now_s = time.monotonic()
            if not self.is_frozen and now_s >= self._next_s + self.delay_s:
                return self._frame(now_s)
            if now_s >= deadline_s:
                raise DeviceTimeout("scripted", "a picture", timeout_s)
            time.sleep(0.0005)

    def controls(self) -> Mapping[ControlName, Control]:
        if not self._is_open:
            raise DeviceLost("scripted", "is unplugged")
        with self._lock:
            return {n: Control(n, v, 0.0, 1e6, v is None) for n, v in self._values.items()}

    def set_control(self, name: ControlName, value: float | None) -> Control:
        if not self._is_open:
            raise DeviceLost("scripted", "is unplugged")
        with self._lock:
            if name not in self._values:
                raise lacks("scripted", name)
            if value is not None and value > 1e6:
                raise DeviceError("scripted", "cannot do that")
            self.written.append((name, value))
            chosen = None if value is None else float(round(value))
            self._values[name] = chosen
            if name is ControlName.EXPOSURE:
                self._history.append((time.monotonic() + self.late_s, chosen))
            return Control(name, chosen, 0.0, 1e6, value is None)

    def _frame(self, now_s: float) -> RawFrame:
        exposed_s = self._next_s
        self._next_s = max(self._next_s + 1.0 / self.fps, now_s - self.delay_s - 1.0 / self.fps)
        if not self.is_stuck:
            self._number += 1
        self.numbers.append(self._number)
        with self._lock:
            set_before = [value for at_s, value in self._history if at_s <= exposed_s]
        exposure_us = set_before[-1] if set_before else None
        self.exposures.append((exposed_s, exposure_us))
        return RawFrame(self.picture(self._number), exposed_s if self.is_timed else None, exposure_us)


def jpeg_picture(number: int) -> bytes:
    return encode(noise_picture(number), "jpeg")
