"""picamera2 as far as it is used: a module with a sensor that takes over controls some pictures late."""

import time
from collections import deque
from types import ModuleType
from typing import Any

from scripted_camera import noise_picture

from app.vision.stripe import Image

_UNDER_WAY = 3


class FakeSensor:
    """The hardware.

    Attributes:
        listed: what libcamera lists.
        controls: name to lowest, highest and default.
        row_us: exposure counts in these.
    """

    def __init__(self) -> None:
        self.listed = [{"Model": "imx219", "Id": "/base/soc/i2c0mux/i2c@1/imx219@10", "Num": 0}]
        self.controls: dict[str, tuple[Any, Any, Any]] = {
            "ExposureTime": (75, 11_766_829, 20_000),
            "AnalogueGain": (1.0, 10.67, 1.0),
            "AeEnable": (False, True, True),
            "AwbEnable": (False, True, True),
            "Brightness": (-1.0, 1.0, 0.0),
        }
        self.row_us = 19
        self.is_gone = self.is_busy = False
        self.written: list[dict[str, Any]] = []

    def module(self, name: str) -> ModuleType:
        assert name == "picamera2"
        sensor, module = self, ModuleType(name)

        class Picamera2(_Picamera2):
            def __init__(self, number: int) -> None:
                super().__init__(sensor, number)

            @staticmethod
            def global_camera_info() -> list[dict[str, Any]]:
                return [] if sensor.is_gone else sensor.listed

        module.Picamera2 = Picamera2  # type: ignore[attr-defined]
        return module


class _Picamera2:
    def __init__(self, sensor: FakeSensor, number: int) -> None:
        if sensor.is_busy:
            raise RuntimeError("Camera __init__ sequence did not complete.")
        self._sensor, self._number = sensor, number
        sensor.is_busy = True
        self._size, self._values = (0, 0), {"ExposureTime": 20_000, "AnalogueGain": 1.0}
        self._under_way: deque[dict[str, Any]] = deque([dict(self._values)] * _UNDER_WAY)
        self._count = 0

    @property
    def camera_controls(self) -> dict[str, tuple[Any, Any, Any]]:
        return self._sensor.controls

    def create_video_configuration(self, **wishes: Any) -> dict[str, Any]:
        assert wishes["main"]["format"] == "RGB888"
        assert wishes["queue"] is False
        return wishes

    def configure(self, wishes: dict[str, Any]) -> None:
        width, height = wishes["main"]["size"]
        self._size = (width - width % 2, height - height % 2)

    def camera_configuration(self) -> dict[str, Any]:
        return {"main": {"size": self._size}}

    def start(self) -> None:
        """It runs."""

    def stop(self) -> None:
        """It stands still."""

    def close(self) -> None:
        self._sensor.is_busy = False

    def set_controls(self, values: dict[str, Any]) -> None:
        self._sensor.written.append(dict(values))
        self._values.update(values)
        self._values["ExposureTime"] -= self._values["ExposureTime"] % self._sensor.row_us

    def capture_request(self) -> "_Request":
        if self._sensor.is_gone:
            raise RuntimeError("Camera frontend has timed out!")
        time.sleep(0.005)
        self._under_way.append(dict(self._values))
        taken = self._under_way.popleft()
        self._count += 1
        told = {key: taken[key] for key in ("ExposureTime", "AnalogueGain")}
        told["SensorTimestamp"] = time.clock_gettime_ns(time.CLOCK_BOOTTIME)
        return _Request(noise_picture(self._count, self._size), told)


class _Request:
    def __init__(self, picture: Image, metadata: dict[str, Any]) -> None:
        self._picture, self._metadata = picture, metadata
        self._is_released = False

    def make_array(self, stream: str) -> Image:
        assert stream == "main"
        return self._picture

    def get_metadata(self) -> dict[str, Any]:
        return self._metadata

    def release(self) -> None:
        assert not self._is_released
        self._is_released = True
