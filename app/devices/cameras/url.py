"""A camera in the network: MJPEG over HTTP, or RTSP. A phone with a camera app is one."""

import contextlib
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from app.devices.camera_controls import lacks
from app.devices.camera_driver import CAMERAS, CameraFacts, Control, ControlName, RawFrame
from app.devices.capture_controls import Capture
from app.devices.http_pictures import Address, HttpPictures, shown
from app.devices.opencv_quiet import opencv_quiet
from app.devices.reading_thread import BlockingSource, ReadingThread
from app.errors import DeviceError, DeviceLost, DeviceNotFound, DeviceUnrecognised
from app.recording.picture import inspect

_HTTP = ("http://", "https://")
_FFMPEG = ("rtsp://", "rtsps://", "rtmp://", "udp://", "rtp://")
_FIRST_PICTURE_S = 5.0
# Packets over TCP, because a lost one tears a picture; nothing kept back, because old pictures are of no use.
_FFMPEG_OPTIONS = "rtsp_transport;tcp|fflags;nobuffer|flags;low_delay"
_RTSP_HINT = "Check the address, its path, and that no other program holds the camera."


class UrlCamera:
    """Pictures from an address. It has no controls, and does not tell when a picture was exposed.

    Attributes:
        url: http:// and https:// for MJPEG, or for a JPEG that is fetched again and again; rtsp:// and its
            kin for video. A name and password may stand in it; messages leave them out.
        name: what messages call it.
        fps: how often a single picture is fetched at most.
        checks_certificate: whether https:// must prove who it is.
        timeout_s: for connecting, and for a silence.
    """

    def __init__(
        self,
        url: str,
        *,
        name: str = "camera",
        fps: float = 15.0,
        checks_certificate: bool = True,
        timeout_s: float = 5.0,
        capture_class: Callable[[str, int, Sequence[int]], Capture] | None = None,
    ) -> None:
        self.name, self.fps, self.timeout_s = name, fps, timeout_s
        self._address = Address(url, checks_certificate, timeout_s)
        self._open_capture = capture_class or cv2.VideoCapture
        self._reader: ReadingThread[BlockingSource] | None = None
        self._facts: CameraFacts | None = None
        self._first: RawFrame | None = None

    @property
    def facts(self) -> CameraFacts:
        if self._facts is None:
            raise self._not_connected()
        return self._facts

    def connect(self) -> None:
        self.disconnect()
        url = self._address.url
        if not url.startswith(_HTTP + _FFMPEG):
            hint = f"Give an address that begins with one of: {', '.join(_HTTP + _FFMPEG)}."
            raise DeviceNotFound(self.name, f"{shown(url)} is no address of a camera", hint)
        reader = ReadingThread(self.name, self._open, 2.0 * self.timeout_s)
        try:
            first = reader.grab(_FIRST_PICTURE_S)
            size, gives_jpeg = self._size_of(first)
        except DeviceError:
            reader.close()
            raise
        self._first, self._reader = first, reader
        self._facts = CameraFacts("network camera", self._address.shown, size, 0.0, False, gives_jpeg)

    def disconnect(self) -> None:
        reader, self._reader = self._reader, None
        if reader is not None:
            reader.close()

    def grab(self, timeout_s: float) -> RawFrame:
        reader = self._connected()
        first, self._first = self._first, None
        return first or reader.grab(timeout_s)

    def controls(self) -> Mapping[ControlName, Control]:
        self._connected()
        return {}

    def set_control(self, name: ControlName, value: float | None) -> Control:
        self._connected()
        raise lacks(self.name, name)

    def _connected(self) -> ReadingThread[BlockingSource]:
        if self._reader is None:
            raise self._not_connected()
        return self._reader

    def _not_connected(self) -> DeviceError:
        return DeviceLost(self.name, "is not connected")

    def _open(self) -> BlockingSource:
        if self._address.url.startswith(_HTTP):
            return HttpPictures(self.name, self._address, self.fps)
        return self._open_video()

    def _open_video(self) -> "_NetworkVideo":
        timeout_ms = round(1000.0 * self.timeout_s)
        wishes = [
            cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, timeout_ms, cv2.CAP_PROP_READ_TIMEOUT_MSEC, timeout_ms,
        ]  # fmt: skip
        with opencv_quiet(), _for_live_video():
            capture = self._open_capture(self._address.url, cv2.CAP_FFMPEG, wishes)
        if not capture.isOpened():
            capture.release()
            raise DeviceNotFound(self.name, f"{self._address.shown} gives no video", _RTSP_HINT)
        return _NetworkVideo(self.name, self._address.shown, capture)

    def _size_of(self, frame: RawFrame) -> tuple[tuple[int, int], bool]:
        """Width and height, and whether it is JPEG."""
        if isinstance(frame.data, bytes):
            try:
                return inspect(frame.data).size, True
            except ValueError as error:
                problem = f"{self._address.shown} sends a picture that {error}"
                raise DeviceUnrecognised(self.name, problem, "Check the address.") from error
        height, width = np.asarray(frame.data).shape[:2]
        return (width, height), False


@dataclass(frozen=True, slots=True)
class _NetworkVideo:
    """Video that FFmpeg receives and decodes."""

    name: str
    shown: str
    capture: Capture

    def read(self) -> RawFrame | None:
        is_read, picture = self.capture.read()
        if not is_read or picture is None:
            raise DeviceLost(self.name, f"{self.shown} sends no more video")
        return RawFrame(np.asarray(picture, np.uint8))

    def interrupt(self) -> None:
        """FFmpeg keeps its own timeout."""

    def close(self) -> None:
        self.capture.release()


@contextlib.contextmanager
def _for_live_video() -> Iterator[None]:
    """FFmpeg's options come from the environment alone."""
    before = os.environ.get("OPENCV_FFMPEG_CAPTURE_OPTIONS")
    os.environ["OPENCV_FFMPEG_CAPTURE_OPTIONS"] = before or _FFMPEG_OPTIONS
    try:
        yield
    finally:
        if before is None:
            del os.environ["OPENCV_FFMPEG_CAPTURE_OPTIONS"]


CAMERAS.register("url", UrlCamera)
