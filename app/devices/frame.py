"""One picture of a live camera: decoded when somebody looks at it, stored as the camera made it."""

import threading
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Literal, TypeAlias

import cv2
import numpy as np

from app.devices.camera_driver import Picture, RawFrame, pixels_of
from app.errors import DeviceError
from app.recording.picture import ImageFormat, encode
from app.vision.stripe import Image

Rotation: TypeAlias = Literal[0, 90, 180, 270]

_TURNS = {90: cv2.ROTATE_90_CLOCKWISE, 180: cv2.ROTATE_180, 270: cv2.ROTATE_90_COUNTERCLOCKWISE}


class Use(StrEnum):
    """What pictures are taken for; a camera has settings for each."""

    LASER = "laser"
    TEXTURE = "texture"
    BOARD = "board"


@dataclass(frozen=True, slots=True)
class Mounting:
    """How the camera hangs, and what makes its pictures upright again.

    Attributes:
        rotation: degrees clockwise by which a picture is turned.
        is_mirrored: whether left and right are exchanged afterwards.
    """

    rotation: Rotation = 0
    is_mirrored: bool = False

    @property
    def is_plain(self) -> bool:
        """Whether pictures stay as they come."""
        return self.rotation == 0 and not self.is_mirrored

    def size(self, size: tuple[int, int]) -> tuple[int, int]:
        """Width and height of an upright picture."""
        return size if self.rotation in (0, 180) else (size[1], size[0])

    def upright(self, image: Image) -> Image:
        if self.rotation:
            image = np.asarray(cv2.rotate(image, _TURNS[self.rotation]), np.uint8)
        if self.is_mirrored:
            image = np.asarray(cv2.flip(image, 1), np.uint8)
        return image


class LazyPicture:
    """The picture of a raw frame; made, decoded and turned once, by whichever thread asks first.

    Args:
        raw: as the driver gave it.
        size: width and height that it must have, as the camera sends it.
        mounting: how it becomes upright.
        where: names camera and frame in messages.
    """

    def __init__(self, raw: RawFrame, size: tuple[int, int], mounting: Mounting, where: str) -> None:
        self._data, self._size, self._mounting, self._where = raw.data, size, mounting, where
        self._images: dict[bool, Image] = {}
        self._lock = threading.Lock()

    def image(self, grey: bool) -> Image:
        with self._lock:
            if grey not in self._images:
                self._images[grey] = self._mounting.upright(self._pixels(grey))
            return self._images[grey]

    def encoded(self, otherwise: ImageFormat) -> bytes:
        with self._lock:
            data = self._made()
        if isinstance(data, bytes) and self._mounting.is_plain:
            return data
        return encode(self.image(False), otherwise)

    def _made(self) -> Picture:
        if callable(self._data):
            self._data = self._data()
        return self._data

    def _pixels(self, grey: bool) -> Image:
        try:
            image = pixels_of(self._made(), self._size, grey=grey)
        except ValueError as error:
            raise DeviceError(self._where, f"the picture {error}", "Check the camera's cable.") from error
        if grey and image.ndim == 3:
            return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)
        return image


@dataclass(frozen=True, eq=False, slots=True)
class Frame:
    """A picture and when it was taken. Any number of threads may look at it.

    Attributes:
        index: counts from 0 since the camera was connected.
        size: width and height, upright.
        exposed_s: monotonic time at which its exposure began: told by the camera, or its arrival less the
            camera's latency.
        arrived_s: monotonic time at which it reached the program.
        exposure_us: how long it was exposed, where known.
        is_timed: whether the camera told `exposed_s`.
    """

    index: int
    size: tuple[int, int]
    exposed_s: float
    arrived_s: float
    exposure_us: float | None
    is_timed: bool
    picture: LazyPicture = field(repr=False)

    def image(self, *, grey: bool = False) -> Image:
        """The pixels, (H, W, 3) BGR; (H, W) with `grey` and from a camera without colours. Not to be changed.

        Raises:
            DeviceError: the camera sent something that is no whole picture.
        """
        return self.picture.image(grey)

    def encoded(self, otherwise: ImageFormat = "png") -> bytes:
        """The file to store: the camera's own where it sent one and it need not be turned, else a new one.

        Args:
            otherwise: format of a new one.
        """
        return self.picture.encoded(otherwise)
