"""The camera of a Raspberry Pi, by picamera2."""

import importlib
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np

from app.devices.camera_controls import lacks
from app.devices.camera_driver import CAMERAS, CameraFacts, Control, ControlName, RawFrame
from app.devices.read_ahead_camera import ReadAheadCamera
from app.errors import DeviceDenied, DeviceLost, DeviceNotFound, DeviceRefused
from app.vision.stripe import Image

_OPEN_S = 15.0
_MOST_UNDER_WAY = 10
# Exposure counts lines of the sensor and gain has steps, so what was asked is met nearly.
_NEAR = 0.05
_MISSING_HINT = (
    "Install it: `sudo apt install python3-picamera2`, and make Turnscan's environment with "
    "`--system-site-packages`; or `pip install 'turnscan[picamera]'`."
)
_CABLE_HINT = "Check the ribbon cable at both ends; `rpicam-hello --list-cameras` must list the camera."
# libcamera's name of each control, its switch between automatic (first) and manual (second), and its unit.
_AUTOMATIC = {
    ControlName.EXPOSURE: ("AeEnable", True, False),
    ControlName.GAIN: ("AeEnable", True, False),
    ControlName.WHITE_BALANCE: ("AwbEnable", True, False),
    ControlName.FOCUS: ("AfMode", 2, 0),
}
_VALUES = {
    ControlName.EXPOSURE: "ExposureTime",
    ControlName.GAIN: "AnalogueGain",
    ControlName.WHITE_BALANCE: "ColourTemperature",
    ControlName.FOCUS: "LensPosition",
    ControlName.BRIGHTNESS: "Brightness",
}


class PiCamera(ReadAheadCamera["_Sensor"]):
    """A camera on the ribbon cable. It tells to the microsecond when each picture was exposed.

    Pictures come as pixels. Exposure is in microseconds, gain in times, focus in dioptres, white balance in
    kelvin where libcamera takes that. Automatic exposure and gain go together: who sets one takes both.

    Attributes:
        number: which one, where there are two.
        name: what messages call it.
        width, height, fps: of the pictures.
    """

    def __init__(
        self,
        number: int = 0,
        *,
        name: str = "camera",
        width: int = 1640,
        height: int = 1232,
        fps: float = 30.0,
        load: Callable[[str], ModuleType] = importlib.import_module,
    ) -> None:
        super().__init__(name, _OPEN_S)
        self.number, self.fps = number, fps
        self.width, self.height = width, height
        self._load = load

    def _open(self) -> "_Sensor":
        try:
            library = self._load("picamera2")
        except ImportError as error:
            raise DeviceNotFound(
                self.name, "the library picamera2 is not there, which this camera needs", _MISSING_HINT
            ) from error
        listed = library.Picamera2.global_camera_info()
        if self.number >= len(listed):
            there = f"{len(listed)} there" if listed else "none there"
            raise DeviceNotFound(self.name, f"there is no Pi camera {self.number} ({there})", _CABLE_HINT)
        try:
            camera = library.Picamera2(self.number)
        except (RuntimeError, OSError) as error:
            raise DeviceDenied(self.name, f"another program uses Pi camera {self.number}") from error
        try:
            # libcamera's RGB888 lies in memory as blue, green, red.
            wish = {"size": (self.width, self.height), "format": "RGB888"}
            camera.configure(
                camera.create_video_configuration(main=wish, controls={"FrameRate": self.fps}, queue=False)
            )
            camera.start()
            width, height = camera.camera_configuration()["main"]["size"]
        except BaseException:
            camera.close()
            raise
        place = str(listed[self.number].get("Id", self.number))
        facts = CameraFacts(
            str(listed[self.number].get("Model", "Pi camera")), place, (width, height), self.fps, True, False
        )
        return _Sensor(self.name, camera, facts, {})


@dataclass(frozen=True, slots=True)
class _Sensor:
    """A camera that runs; used by its reading thread alone.

    Attributes:
        metadata: of the newest picture, which is where libcamera tells what its controls really are.
    """

    name: str
    camera: Any
    facts: CameraFacts
    metadata: dict[str, Any]

    def read(self) -> RawFrame | None:
        picture, told = self._take()
        self.metadata.update(told)
        exposure_us, stamp_ns = told.get("ExposureTime"), told.get("SensorTimestamp")
        if exposure_us is None or stamp_ns is None:
            return RawFrame(picture)
        # libcamera promises when the first row began to be exposed; on a Pi it is when that row was read out.
        exposed_s = _monotonic_s(float(stamp_ns) / 1e9) - float(exposure_us) / 1e6
        return RawFrame(picture, exposed_s, float(exposure_us))

    def _take(self) -> tuple[Image, dict[str, Any]]:
        """A picture and what libcamera tells of it."""
        try:
            request = self.camera.capture_request()
        except (RuntimeError, OSError) as error:
            raise DeviceLost(self.name, "sends no more pictures") from error
        try:
            return np.array(request.make_array("main")[..., :3], np.uint8), dict(request.get_metadata())
        finally:
            request.release()

    def controls(self) -> dict[ControlName, Control]:
        present = self.camera.camera_controls
        return {name: self._control(name) for name, key in _VALUES.items() if key in present}

    def set_control(self, name: ControlName, value: float | None) -> Control:
        present = self.camera.camera_controls
        key = _VALUES[name]
        if key not in present:
            raise lacks(self.name, name)
        switch, automatic, manual = _AUTOMATIC.get(name, ("", None, None))
        if value is None:
            if switch not in present:
                words = name.value.replace("_", " ")
                raise DeviceRefused(self.name, f"does not choose its {words} by itself", "Give it a value.")
            self._write({switch: automatic})
            return self._control(name)
        lowest, highest, _ = present[key]
        chosen = min(max(value, float(lowest)), float(highest))
        whole = round(chosen) if isinstance(lowest, int) else chosen
        self._write({switch: manual, key: whole} if switch in present else {key: whole})
        self._await(key, whole)
        return self._control(name)

    def interrupt(self) -> None:
        """A request comes or the camera is stopped; nothing else ends it."""

    def close(self) -> None:
        self.camera.stop()
        self.camera.close()

    def _write(self, values: dict[str, Any]) -> None:
        self.camera.set_controls(values)
        # What was asked holds until a picture tells what became of it.
        self.metadata.update(values)

    def _await(self, key: str, value: float) -> None:
        """Let the pictures pass that were under way, until one tells that it was taken with the value."""
        for _ in range(_MOST_UNDER_WAY):
            _, told = self._take()
            self.metadata.update(told)
            if key not in told or math.isclose(told[key], value, rel_tol=_NEAR, abs_tol=1e-3):
                return

    def _control(self, name: ControlName) -> Control:
        lowest, highest, default = self.camera.camera_controls[_VALUES[name]]
        value = self.metadata.get(_VALUES[name], default)
        switch, automatic, _ = _AUTOMATIC.get(name, ("", None, None))
        is_automatic = bool(switch) and self.metadata.get(switch, automatic) == automatic
        return Control(
            name, None if value is None else float(value), float(lowest), float(highest), is_automatic
        )


def _monotonic_s(boot_s: float) -> float:
    """libcamera stamps with the clock that goes on while the machine sleeps."""
    boottime = getattr(time, "CLOCK_BOOTTIME", None)
    if boottime is None:
        return boot_s
    return boot_s - (time.clock_gettime(boottime) - time.monotonic())


CAMERAS.register("picamera", PiCamera)
