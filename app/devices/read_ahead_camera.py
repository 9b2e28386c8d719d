"""Drivers of cameras whose reads block: a thread keeps the camera, and everything is asked through that."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Generic, Protocol, TypeVar

from app.devices.camera_driver import CameraFacts, Control, ControlName, RawFrame
from app.devices.reading_thread import BlockingSource, ReadingThread
from app.errors import DeviceError, DeviceLost


class OpenCamera(BlockingSource, Protocol):
    """A camera that is open; used by its reading thread alone."""

    @property
    def facts(self) -> CameraFacts: ...

    def controls(self) -> Mapping[ControlName, Control]: ...

    def set_control(self, name: ControlName, value: float | None) -> Control: ...


C = TypeVar("C", bound=OpenCamera)


class ReadAheadCamera(ABC, Generic[C]):
    """A `CameraDriver` over a `ReadingThread`.

    Args:
        name: what messages call the camera.
        open_timeout_s: how long opening may take.
    """

    def __init__(self, name: str, open_timeout_s: float) -> None:
        self.name, self.open_timeout_s = name, open_timeout_s
        self._reader: ReadingThread[C] | None = None
        self._facts: CameraFacts | None = None

    @abstractmethod
    def _open(self) -> C:
        """Open the camera; runs in the reading thread."""

    @property
    def facts(self) -> CameraFacts:
        if self._facts is None:
            raise self._not_connected()
        return self._facts

    def connect(self) -> None:
        self.disconnect()
        reader = ReadingThread(self.name, self._open, self.open_timeout_s)
        self._facts = reader.ask(lambda camera: camera.facts)
        self._reader = reader

    def disconnect(self) -> None:
        reader, self._reader = self._reader, None
        if reader is not None:
            reader.close()

    def grab(self, timeout_s: float) -> RawFrame:
        return self._connected().grab(timeout_s)

    def controls(self) -> Mapping[ControlName, Control]:
        return self._connected().ask(lambda camera: camera.controls())

    def set_control(self, name: ControlName, value: float | None) -> Control:
        return self._connected().ask(lambda camera: camera.set_control(name, value))

    def _connected(self) -> ReadingThread[C]:
        if self._reader is None:
            raise self._not_connected()
        return self._reader

    def _not_connected(self) -> DeviceError:
        return DeviceLost(self.name, "is not connected")
