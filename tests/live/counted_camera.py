"""A camera whose pictures are made when somebody looks, and that counts how often that is."""

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

import numpy as np

from app.devices.camera import Camera
from app.devices.camera_driver import CameraFacts, Control, ControlName, Picture, RawFrame
from app.devices.frame import Mounting
from app.errors import DeviceLost, DeviceNotFound, DeviceTimeout
from app.live.picture import LivePicture
from app.live.pictures import LivePictures
from app.live.viewer import LiveViewer
from app.recording.picture import encode
from app.vision.stripe import Image

SIZE = (320, 240)
SOON_S = 60.0


class CountedCamera:
    """Red stripes on grey, at column `stripe_column`, as JPEG of the camera's own.

    Attributes:
        developed: numbers of the pictures that somebody looked at.
        is_held: no picture comes until `release`.
        is_gone: as if unplugged.
        gives_jpeg: else it hands over pixels.
        damage: data of all pictures instead.
    """

    def __init__(self, fps: float = 100.0) -> None:
        self.fps, self.gives_jpeg, self.is_gone, self.is_held = fps, True, False, False
        self.developed: list[int] = []
        self.damage: bytes | None = None
        self._changed = threading.Condition()
        self._number = self._released = 0
        self._next_s = 0.0

    @property
    def facts(self) -> CameraFacts:
        return CameraFacts("counted", "nowhere", SIZE, self.fps, True, self.gives_jpeg)

    def connect(self) -> None:
        if self.is_gone:
            raise DeviceNotFound("counted", "is not there")
        self._next_s = time.monotonic()

    def disconnect(self) -> None:
        """Nothing is held."""

    def release(self, count: int = 1) -> None:
        """So many pictures come although it is held."""
        with self._changed:
            self._released += count
            self._changed.notify_all()

    def grab(self, timeout_s: float) -> RawFrame:
        ends_s = time.monotonic() + timeout_s
        with self._changed:
            while self._wait_s() > 0.0:
                left_s = ends_s - time.monotonic()
                if self.is_gone:
                    raise DeviceLost("counted", "is unplugged")
                if left_s <= 0.0:
                    raise DeviceTimeout("counted", "a picture", timeout_s)
                self._changed.wait(min(left_s, self._wait_s(), 0.02))
            if self.is_gone:
                raise DeviceLost("counted", "is unplugged")
            self._released = max(0, self._released - 1)
            self._number += 1
            now_s = time.monotonic()
            self._next_s = max(self._next_s + 1.0 / self.fps, now_s)
            return RawFrame(self._developer(self._number), now_s, 1000.0)

    def controls(self) -> Mapping[ControlName, Control]:
        return {}

    def set_control(self, name: ControlName, value: float | None) -> Control:
        raise NotImplementedError(name)

    def _wait_s(self) -> float:
        if self.is_held:
            return 0.0 if self._released else 1.0
        return self._next_s - time.monotonic()

    def _developer(self, number: int) -> Callable[[], Picture]:
        def develop() -> Picture:
            self.developed.append(number)
            if self.damage is not None:
                return self.damage
            image = stripe_picture(number)
            return encode(image, "jpeg") if self.gives_jpeg else image

        return develop


def stripe_column(number: int) -> float:
    """Where the stripe of a picture lies."""
    return 60.0 + number % 16


def stripe_picture(number: int, level: float = 150.0) -> Image:
    columns = np.arange(SIZE[0])
    light = level * np.exp(-0.5 * ((columns - stripe_column(number)) / 1.8) ** 2)
    image = np.full((SIZE[1], SIZE[0], 3), 30.0)
    image[:, :, 2] += light
    return np.asarray(np.clip(image, 0, 255), np.uint8)


@contextmanager
def watched(live: LivePictures, camera: Camera | None = None) -> Iterator[LivePictures]:
    """Closes everything in the end."""
    try:
        yield live
    finally:
        live.close()
        if camera is not None:
            camera.disconnect()


def connected(driver: CountedCamera, mounting: Mounting | None = None) -> Camera:
    camera = Camera(driver, name="counted")
    if mounting is not None:
        camera.mounting = mounting
    camera.connect()
    return camera


def wait_until(is_so: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + SOON_S
    while not is_so():
        assert time.monotonic() < deadline_s, "it did not happen"
        time.sleep(0.002)


def next_of(viewer: LiveViewer) -> LivePicture:
    """A picture surely comes."""
    picture = viewer.next(SOON_S)
    assert picture is not None
    return picture


def taken(viewer: LiveViewer) -> LivePicture:
    """The picture that was asked for, once it is there."""
    pictures: list[LivePicture] = []

    def has_come() -> bool:
        picture = viewer.take()
        if picture is not None:
            pictures.append(picture)
        return picture is not None

    wait_until(has_come)
    return pictures[0]
