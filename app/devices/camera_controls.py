"""What was asked of a camera's controls, so that it is asked once, and again when the camera comes back."""

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from app.devices.camera_driver import CameraDriver, Control, ControlName
from app.errors import DeviceError, DeviceLost, DeviceRefused, DeviceTimeout


@dataclass(frozen=True, slots=True)
class CameraSettings:
    """What the controls are to be while pictures of one use are taken.

    Attributes:
        controls: value of each control, in the units of `ControlName`; None for the camera's own automatic.
    """

    controls: Mapping[ControlName, float | None] = field(default_factory=dict)


def lacks(device: str, name: ControlName) -> DeviceRefused:
    """The error of a camera that is asked for a control it does not have."""
    words = name.value.replace("_", " ")
    return DeviceRefused(device, f"has no control of its {words}", "Leave it out of the bench file.")


class WantedControls:
    """The controls of one camera, and what they are to be. Any thread may ask; one at a time is served.

    Args:
        driver: the camera.
        check: raises where the camera is not open.
        on_change: called after every value that was written.
    """

    def __init__(
        self, driver: CameraDriver, check: Callable[[], None], on_change: Callable[[], None]
    ) -> None:
        self._driver, self._check, self._on_change = driver, check, on_change
        self._wanted: dict[ControlName, float | None] = {}
        self._lock = threading.RLock()

    @property
    def exposure_s(self) -> float:
        """The exposure that was asked for; 0 where none was."""
        return (self._wanted.get(ControlName.EXPOSURE) or 0.0) / 1e6

    def read(self) -> Mapping[ControlName, Control]:
        with self._lock:
            self._check()
            return self._driver.controls()

    def write(self, name: ControlName, value: float | None) -> Control:
        """What the camera made of it. While it is away the value is kept for when it is back."""
        with self._lock:
            before = dict(self._wanted)
            self._wanted[name] = value
            self._check()
            try:
                control = self._driver.set_control(name, value)
            except (DeviceLost, DeviceTimeout):
                raise
            except DeviceError:
                self._wanted = before
                raise
            self._on_change()
            return control

    def apply(self, settings: CameraSettings) -> None:
        """Write what differs from what was asked last, of the controls that the camera has."""
        with self._lock:
            differing = {
                name: value
                for name, value in settings.controls.items()
                if name not in self._wanted or self._wanted[name] != value
            }
            present = self.read() if differing else {}
            for name, value in differing.items():
                if name in present:
                    self.write(name, value)

    def write_again(self) -> str:
        """Everything, to a camera that has just been opened; what it refused, empty if nothing."""
        refused = ""
        with self._lock:
            for name, value in self._wanted.items():
                try:
                    self._driver.set_control(name, value)
                except DeviceError as error:
                    refused = error.problem
            if self._wanted:
                self._on_change()
        return refused
