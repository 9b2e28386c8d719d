"""Controls of a camera that OpenCV captures from, in our units; each of its backends has its own dialect.

OpenCV says nothing when it fails: a property that is missing reads as -1 or 0, a value that was not taken is
only seen by reading it back.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import cv2

from app.devices.camera_controls import lacks
from app.devices.camera_driver import Control, ControlName
from app.errors import DeviceRefused

_ABSENT = (-1.0, 0.0)


class Capture(Protocol):
    """What is used of `cv2.VideoCapture`."""

    def isOpened(self) -> bool: ...  # noqa: N802 (OpenCV's name)
    def read(self) -> tuple[bool, Any]: ...
    def get(self, prop: int, /) -> float: ...
    def set(self, prop: int, value: float, /) -> bool: ...
    def release(self) -> None: ...


@dataclass(frozen=True, slots=True)
class Knob:
    """Where a backend keeps a control.

    Attributes:
        value: property that holds the value.
        automatic: property that says who decides; None where the camera never does.
        on: what hands the control to the camera; the first that is taken counts.
        off: what takes it back; None where writing a value does that, and where it cannot be read.
    """

    value: int
    automatic: int | None = None
    on: tuple[float, ...] = ()
    off: float | None = None


@dataclass(frozen=True, slots=True)
class Backend:
    """One of the ways in which OpenCV reaches cameras.

    Attributes:
        api: its number.
        knobs: the controls that it can reach at all.
        microseconds, exposure: from its unit of exposure to microseconds, and back.
    """

    api: int
    knobs: Mapping[ControlName, Knob] = field(default_factory=dict)
    microseconds: Callable[[float], float] = float
    exposure: Callable[[float], float] = float


# Media Foundation and DirectShow count exposure in powers of two of a second. Their switch to manual
# would write its own value as an exposure; setting an exposure switches by itself.
_WINDOWS_KNOBS = {
    ControlName.EXPOSURE: Knob(cv2.CAP_PROP_EXPOSURE, cv2.CAP_PROP_AUTO_EXPOSURE, (1.0,)),
    ControlName.GAIN: Knob(cv2.CAP_PROP_GAIN),
    ControlName.WHITE_BALANCE: Knob(cv2.CAP_PROP_TEMPERATURE),
    ControlName.FOCUS: Knob(cv2.CAP_PROP_FOCUS, cv2.CAP_PROP_AUTOFOCUS, (1.0,)),
    ControlName.BRIGHTNESS: Knob(cv2.CAP_PROP_BRIGHTNESS),
}


def _power_of_two_us(raw: float) -> float:
    return float(2.0**raw * 1e6)


def _power_of_two(value_us: float) -> float:
    return float(round(math.log2(max(value_us, 1.0) / 1e6)))


BACKENDS: Mapping[str, Backend] = {
    "v4l2": Backend(
        cv2.CAP_V4L2,
        {
            # V4L2_CID_EXPOSURE_AUTO: 1 manual, 3 aperture priority (what webcams have), 0 fully automatic.
            ControlName.EXPOSURE: Knob(cv2.CAP_PROP_EXPOSURE, cv2.CAP_PROP_AUTO_EXPOSURE, (3.0, 0.0), 1.0),
            ControlName.GAIN: Knob(cv2.CAP_PROP_GAIN),
            ControlName.WHITE_BALANCE: Knob(cv2.CAP_PROP_WB_TEMPERATURE, cv2.CAP_PROP_AUTO_WB, (1.0,), 0.0),
            ControlName.FOCUS: Knob(cv2.CAP_PROP_FOCUS, cv2.CAP_PROP_AUTOFOCUS, (1.0,), 0.0),
            ControlName.BRIGHTNESS: Knob(cv2.CAP_PROP_BRIGHTNESS),
        },
        lambda raw: raw * 100.0,
        lambda value_us: max(1.0, float(round(value_us / 100.0))),
    ),
    "msmf": Backend(cv2.CAP_MSMF, _WINDOWS_KNOBS, _power_of_two_us, _power_of_two),
    "dshow": Backend(cv2.CAP_DSHOW, _WINDOWS_KNOBS, _power_of_two_us, _power_of_two),
    "avfoundation": Backend(cv2.CAP_AVFOUNDATION),
}


class CaptureControls:
    """Reads and writes the controls of one open capture, in the thread that owns it.

    Args:
        device: what messages call the camera.
        capture: open.
        backend: whose dialect it speaks.
        ranges: lowest and highest raw value, where the system knows them.
    """

    def __init__(
        self,
        device: str,
        capture: Capture,
        backend: Backend,
        ranges: Mapping[ControlName, tuple[int, int]],
    ) -> None:
        self._device, self._capture, self._backend, self._ranges = device, capture, backend, ranges
        self._knobs = {name: knob for name, knob in backend.knobs.items() if self._has(name, knob)}
        self._left_to_camera = {name for name, knob in self._knobs.items() if knob.automatic is not None}
        self.exposure_us = self._exposure_us()

    def read(self) -> dict[ControlName, Control]:
        """All that the camera has."""
        return {name: self._control(name) for name in self._knobs}

    def write(self, name: ControlName, value: float | None) -> Control:
        """Ask for a value, or with None for the camera's own; what it made of that.

        Raises:
            DeviceRefused: there is no such control, or it does not take the value.
        """
        if name not in self._knobs:
            raise lacks(self._device, name)
        if value is None:
            self._leave(name)
        else:
            self._take(name, value)
        self.exposure_us = self._exposure_us()
        return self._control(name)

    def _leave(self, name: ControlName) -> None:
        knob = self._knobs[name]
        if knob.automatic is None or not any(self._capture.set(knob.automatic, on) for on in knob.on):
            words = name.value.replace("_", " ")
            raise DeviceRefused(self._device, f"does not choose its {words} by itself", "Give it a value.")
        self._left_to_camera.add(name)

    def _take(self, name: ControlName, value: float) -> None:
        knob = self._knobs[name]
        raw = self._backend.exposure(value) if name is ControlName.EXPOSURE else float(round(value))
        if name in self._ranges:
            lowest, highest = self._ranges[name]
            raw = min(max(raw, lowest), highest)
        if knob.automatic is not None and knob.off is not None:
            self._capture.set(knob.automatic, knob.off)
        if not self._capture.set(knob.value, raw):
            words = name.value.replace("_", " ")
            raise DeviceRefused(self._device, f"does not take {value:g} for its {words}")
        self._left_to_camera.discard(name)

    def _control(self, name: ControlName) -> Control:
        lowest, highest = self._ranges.get(name, (None, None))
        knob = self._knobs[name]
        is_automatic = name in self._left_to_camera
        if knob.automatic is not None and knob.off is not None:
            is_automatic = self._capture.get(knob.automatic) not in (knob.off, -1.0)
        return Control(
            name, self._in_our_unit(name, self._capture.get(knob.value)),
            None if lowest is None else self._in_our_unit(name, lowest),
            None if highest is None else self._in_our_unit(name, highest),
            is_automatic,
        )  # fmt: skip

    def _in_our_unit(self, name: ControlName, raw: float) -> float:
        return self._backend.microseconds(raw) if name is ControlName.EXPOSURE else float(raw)

    def _exposure_us(self) -> float | None:
        if ControlName.EXPOSURE not in self._knobs:
            return None
        control = self._control(ControlName.EXPOSURE)
        return None if control.is_automatic else control.value

    def _has(self, name: ControlName, knob: Knob) -> bool:
        """Known by its range, or by a value; where the value may mean absence, by taking it once more."""
        value = self._capture.get(knob.value)
        return name in self._ranges or value not in _ABSENT or self._capture.set(knob.value, value)
