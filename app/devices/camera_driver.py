"""What a kind of camera does for the bench: one frame after the other, and its controls."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol, TypeAlias

import numpy as np

from app.recording.picture import decode
from app.registry import Registry
from app.vision.stripe import Image

Picture: TypeAlias = bytes | Image


class ControlName(StrEnum):
    """Controls that cameras may have; a value is in the unit given here."""

    EXPOSURE = "exposure"  # microseconds
    GAIN = "gain"  # the camera's own scale
    WHITE_BALANCE = "white_balance"  # kelvin
    FOCUS = "focus"  # the camera's own scale
    BRIGHTNESS = "brightness"  # the camera's own scale


@dataclass(frozen=True, slots=True)
class Control:
    """A control as the camera has it.

    Attributes:
        name: which.
        value: what the camera says it is; None where it does not tell.
        lowest, highest: its range; None where unknown.
        is_automatic: whether the camera changes it by itself.
    """

    name: ControlName
    value: float | None
    lowest: float | None = None
    highest: float | None = None
    is_automatic: bool = False


@dataclass(frozen=True, slots=True)
class CameraFacts:
    """What a connected camera is.

    Attributes:
        name: what it calls itself.
        place: where it is connected: device path, URL or folder.
        size: width and height of its pictures, pixels.
        fps: pictures per second that it says it delivers.
        has_timestamps: whether it tells when a picture was exposed.
        gives_jpeg: whether pictures come as JPEG that can be stored as they are.
    """

    name: str
    place: str
    size: tuple[int, int]
    fps: float
    has_timestamps: bool
    gives_jpeg: bool


@dataclass(frozen=True, eq=False, slots=True)
class RawFrame:
    """A picture as a driver has it.

    Attributes:
        data: the camera's own JPEG; or the pixels, (H, W) or (H, W, 3) BGR, uint8; or a function that gives
            one of these when somebody really looks at the picture.
        exposed_s: monotonic time at which its exposure began, where the camera tells; else None.
        exposure_us: how long it was exposed, where known.
        arrived_s: monotonic time at which a driver that reads ahead got it; None where that is now.
    """

    data: Picture | Callable[[], Picture]
    exposed_s: float | None = None
    exposure_us: float | None = None
    arrived_s: float | None = None


class CameraDriver(Protocol):
    """A camera as it is; `app.devices.camera.Camera` makes of it what the bench uses.

    Only one thread at a time calls `grab`; controls may be set from another.
    """

    @property
    def facts(self) -> CameraFacts:
        """Known once connected."""
        ...

    def connect(self) -> None:
        """Open the camera. Raises the errors of `app.errors` that begin with `Device`."""
        ...

    def disconnect(self) -> None:
        """Let go of it. Never fails."""
        ...

    def grab(self, timeout_s: float) -> RawFrame:
        """The next picture, in order; waits for it.

        Raises:
            DeviceTimeout: none came in time.
            DeviceLost: the camera is gone.
        """
        ...

    def controls(self) -> Mapping[ControlName, Control]:
        """The controls that this camera has; what is missing here it lacks."""
        ...

    def set_control(self, name: ControlName, value: float | None) -> Control:
        """Ask for a value, or with None for the camera's own automatic; return what the camera made of it.

        Raises:
            DeviceRefused: the camera has no such control.
        """
        ...


def pixels_of(data: Picture, size: tuple[int, int], *, grey: bool = False) -> Image:
    """The pixels of a raw frame; JPEG is decoded straight to grey where that is all that is wanted.

    Raises:
        ValueError: the data is no whole picture of that size.
    """
    if isinstance(data, bytes):
        return decode(data, size, grey=grey)
    if data.shape[:2] != (size[1], size[0]):
        raise ValueError(f"is {data.shape[1]} x {data.shape[0]} pixels instead of {size[0]} x {size[1]}")
    return np.ascontiguousarray(data)


CAMERAS: Registry[CameraDriver] = Registry("camera", "app.devices.cameras")
