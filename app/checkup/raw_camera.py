"""The camera without its thread: who reads when is part of what is measured."""

import contextlib
import math
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass

import cv2
import numpy as np

from app.devices.bench import Bench
from app.devices.camera_driver import CameraDriver, RawFrame, pixels_of
from app.devices.frame import Mounting, Use
from app.errors import DeviceError
from app.geometry.arrays import Floats
from app.vision.stripe import Image

_GRAB_S = 3.0
# The stripe's own pixels: those that gain at least this share of what the brightest gain.
_BRIGHT_SHARE = 0.3
_FEWEST_PIXELS = 30
_LEAST_GAIN = 12.0


@dataclass(frozen=True, eq=False, slots=True)
class Arrival:
    """A raw frame as it came.

    Attributes:
        raw: the frame.
        asked_s, arrived_s: monotonic time at which it was asked for, and there.
    """

    raw: RawFrame
    asked_s: float
    arrived_s: float


@dataclass(frozen=True, eq=False, slots=True)
class Signal:
    """How much of a laser's light is in a picture, against a dark and a lit one.

    Attributes:
        pixels: (H, W) where the light falls.
        dark, lit: means over these.
    """

    pixels: Image
    dark: float
    lit: float

    @classmethod
    def of(cls, dark: Image, lit: Image) -> "Signal | None":
        """From one laser switched alone; None where it gives too little light to tell."""
        gain = cv2.subtract(_grey(lit), _grey(dark))
        pixels = gain > max(_LEAST_GAIN, _BRIGHT_SHARE * float(gain.max()))
        if np.count_nonzero(pixels) < _FEWEST_PIXELS:
            return None
        mask = pixels.astype(np.uint8)
        return cls(mask, _mean(dark, mask), _mean(lit, mask))

    def share(self, image: Image) -> float:
        """0 for dark, 1 for lit."""
        return (_mean(image, self.pixels) - self.dark) / (self.lit - self.dark)


class RawReader:
    """Grabs from a driver that nobody else reads, and keeps when each frame came.

    Attributes:
        driver: the camera, connected.
        mounting: what makes its pictures upright.
    """

    def __init__(self, driver: CameraDriver, mounting: Mounting) -> None:
        self.driver, self.mounting = driver, mounting

    def grab(self) -> Arrival:
        asked_s = time.monotonic()
        raw = self.driver.grab(_GRAB_S)
        return Arrival(raw, asked_s, time.monotonic())

    def grab_for(self, duration_s: float) -> list[Arrival]:
        """Everything that comes from now on, one frame at least, unlooked at."""
        with self.grabbing() as arrivals:
            time.sleep(duration_s)
        return arrivals

    @contextmanager
    def grabbing(self) -> Iterator[list[Arrival]]:
        """Grab in another thread as long as the block goes on, and until one frame is there.

        What happens meanwhile does not make a frame seem to arrive later than it did.

        Raises:
            DeviceError: the camera failed; raised at the end of the block.
        """
        arrivals: list[Arrival] = []
        is_over = threading.Event()

        def grab() -> None:
            while not (is_over.is_set() and arrivals):
                arrivals.append(self.grab())

        with ThreadPoolExecutor(1, "checkup grab") as pool:
            grabbed = pool.submit(grab)
            try:
                yield arrivals
            finally:
                is_over.set()
            grabbed.result()

    def image(self, arrival: Arrival) -> Image:
        """The pixels, upright.

        Raises:
            DeviceError: it is no whole picture.
        """
        data = arrival.raw.data
        try:
            pixels = pixels_of(data() if callable(data) else data, self.driver.facts.size)
        except ValueError as error:
            raise DeviceError("camera", f"the picture {error}", "Check the camera's cable.") from error
        return self.mounting.upright(pixels)


@contextmanager
def raw_reader(bench: Bench, use: Use = Use.LASER) -> Iterator[RawReader]:
    """The bench's camera, read by nobody else inside the block; as before after it."""
    camera = bench.camera
    camera.disconnect()
    camera.driver.connect()
    try:
        wanted = camera.settings[use].controls if use in camera.settings else {}
        for name, value in wanted.items():
            with contextlib.suppress(DeviceError):
                camera.driver.set_control(name, value)
        yield RawReader(camera.driver, camera.mounting)
    finally:
        camera.driver.disconnect()
        camera.connect()


def period_of(arrivals: list[Arrival]) -> float:
    """Seconds from one frame to the next: by the camera's times where it tells them, else by arrival."""
    told = [arrival.raw.exposed_s for arrival in arrivals]
    times: Floats = np.array(
        [t for t in told if t is not None]
        if None not in told
        else [arrival.arrived_s for arrival in arrivals]
    )
    gaps = np.diff(times)
    return float(np.median(gaps)) if len(gaps) else math.nan


def _grey(image: Image) -> Image:
    return image if image.ndim == 2 else np.asarray(image.max(axis=2), np.uint8)


def _mean(image: Image, mask: Image) -> float:
    return float(cv2.mean(_grey(image), mask)[0])
