"""A camera in the network: MJPEG over HTTP, or RTSP. A phone with a camera app is one."""

import contextlib
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from app.devices.camera_controls import lacks
from app.devices.camera_driver import CAMERAS, CameraFacts, Control, ControlName, RawFrame
from app.devices.capture_controls import Capture
from app.devices.http_pictures import HttpPictures
from app.devices.http_request import Address, shown
from app.devices.opencv_quiet import opencv_quiet
from app.devices.read_ahead_camera import ReadAheadCamera
from app.devices.reading_thread import BlockingSource
from app.errors import DeviceLost, DeviceNotFound, DeviceUnrecognised
from app.recording.picture import inspect

_HTTP = ("http://", "https://")
_FFMPEG = ("rtsp://", "rtsps://", "rtmp://", "udp://", "rtp://")
# So many empty pictures in a row are no camera.
_MOST_EMPTY = 10
# Packets over TCP, because a lost one tears a picture; nothing kept back, because old pictures are of no use.
_FFMPEG_OPTIONS = "rtsp_transport;tcp|fflags;nobuffer|flags;low_delay"
_RTSP_HINT = "Check the address, its path, and that no other program holds the camera."


class UrlCamera(ReadAheadCamera["_NetworkCamera"]):
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
        super().__init__(name, 3.0 * timeout_s)
        self.fps, self.timeout_s = fps, timeout_s
        self._address = Address(url, checks_certificate, timeout_s)
        self._open_capture = capture_class or cv2.VideoCapture

    def _open(self) -> "_NetworkCamera":
        url = self._address.url
        if not url.startswith(_HTTP + _FFMPEG):
            hint = f"Give an address that begins with one of: {', '.join(_HTTP + _FFMPEG)}."
            raise DeviceNotFound(self.name, f"{shown(url)} is no address of a camera", hint)
        is_http = url.startswith(_HTTP)
        source = HttpPictures(self.name, self._address, self.fps) if is_http else self._open_video()
        try:
            return self._begin(source)
        except BaseException:
            source.close()
            raise

    def _begin(self, source: BlockingSource) -> "_NetworkCamera":
        """The first picture tells what the camera is."""
        first = next((frame for _ in range(_MOST_EMPTY) if (frame := source.read()) is not None), None)
        if first is None:
            raise DeviceUnrecognised(
                self.name, f"{self._address.shown} sends no picture", "Check the address."
            )
        first = replace(first, arrived_s=time.monotonic())
        size, gives_jpeg = self._size_of(first)
        facts = CameraFacts("network camera", self._address.shown, size, 0.0, False, gives_jpeg)
        return _NetworkCamera(self.name, source, facts, [first])

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
class _NetworkCamera:
    """A source of pictures whose first is known already."""

    name: str
    source: BlockingSource
    facts: CameraFacts
    known: list[RawFrame]

    def read(self) -> RawFrame | None:
        return self.known.pop() if self.known else self.source.read()

    def controls(self) -> Mapping[ControlName, Control]:
        return {}

    def set_control(self, name: ControlName, value: float | None) -> Control:
        raise lacks(self.name, name)

    def interrupt(self) -> None:
        self.source.interrupt()

    def close(self) -> None:
        self.source.close()


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
