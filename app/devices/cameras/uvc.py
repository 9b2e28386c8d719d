"""A webcam or any other camera that the system gives to programs, captured by OpenCV."""

import os
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from app.devices.camera_driver import CAMERAS, CameraFacts, Control, ControlName, RawFrame
from app.devices.capture_controls import BACKENDS, Backend, Capture, CaptureControls
from app.devices.jpeg import whole_jpeg
from app.devices.opencv_quiet import opencv_quiet
from app.devices.read_ahead_camera import ReadAheadCamera
from app.devices.video_nodes import VideoNode, VideoNodes, control_ranges
from app.errors import DeviceDenied, DeviceError, DeviceLost, DeviceNotFound, DeviceUnrecognised, OptionError
from app.recording.picture import inspect
from app.vision.stripe import Image

_OPEN_S = 15.0
_FIRST_PICTURE_S = 5.0
# So many empty reads in a row, and the camera is given up.
_MOST_EMPTY = 5
_MOST_DAMAGED = 10
_EMPTY_PAUSE_S = 0.01
# A time stamp of the monotonic clock is no older than this when its picture arrives.
_OLDEST_S = 1.0
_SYSTEM_BACKENDS = {"linux": "v4l2", "win32": "msmf", "darwin": "avfoundation"}
_MJPG = cv2.VideoWriter.fourcc(*"MJPG")
_PRIVACY = {
    "win32": "Allow programs to use the camera in Settings, Privacy, and close others that use it.",
    "darwin": "Allow the terminal to use the camera in System Settings, Privacy; close others that use it.",
}


class UvcCamera(ReadAheadCamera["_Webcam"]):
    """A camera behind V4L2 on Linux, Media Foundation or DirectShow on Windows, AVFoundation on macOS.

    Pictures come as the camera's own JPEG where it has MJPG and lets it through; else as pixels. Once it was
    connected on Linux it is looked for by its stable link, whatever number it comes back under.

    Attributes:
        device: index, path such as /dev/video0 or a link under /dev/v4l/by-id, or a part of its name.
        name: what messages call it.
        width, height, fps: what is asked for; `facts` says what the camera made of it.
        fourcc: pixel format that is asked for; MJPG reaches the highest rates over USB 2.
        backend: v4l2, msmf, dshow or avfoundation; empty for that of the system.
        buffers: pictures that V4L2 may keep ready. With a single one every other picture is lost.
    """

    def __init__(
        self,
        device: int | str = 0,
        *,
        name: str = "camera",
        width: int = 1280,
        height: int = 720,
        fps: float = 30.0,
        fourcc: str = "MJPG",
        backend: str = "",
        buffers: int = 4,
        capture_class: Callable[[int | str, int], Capture] | None = None,
        nodes: VideoNodes | None = None,
        platform: str = sys.platform,
    ) -> None:
        super().__init__(name, _OPEN_S)
        self.device, self.buffers = device, buffers
        self.width, self.height, self.fps, self.fourcc = width, height, fps, fourcc
        self._platform = platform
        self._backend = _backend_of(backend, platform)
        self._open_capture = capture_class or cv2.VideoCapture
        self._nodes = nodes or VideoNodes()
        self._stable_path: Path | None = None

    def _node(self) -> VideoNode | None:
        """The video node that is meant; None where the system lists none, or not this one."""
        if self._platform != "linux":
            return None
        found = self._nodes.find(self.device if self._stable_path is None else str(self._stable_path))
        if len(found) > 1:
            paths = ", ".join(str(node.stable_path) for node in found)
            raise DeviceError(
                self.name, f"{self.device!r} fits {len(found)} cameras", f"Name one of them: {paths}."
            )
        return found[0] if found else None

    def _target(self, node: VideoNode | None) -> int | str:
        """What OpenCV is to open."""
        if self._platform != "linux":
            if isinstance(self.device, str) and not self.device.isdigit():
                raise DeviceNotFound(
                    self.name,
                    f"{self.device!r} is no number",
                    "Give the camera's number here: 0, 1 and so on.",
                )
            return int(self.device)
        if node is not None:
            path = node.path
        elif isinstance(self.device, str) and "/" in self.device:
            path = Path(self.device)
        elif isinstance(self.device, str) and not self.device.isdigit():
            raise self._not_there()
        else:
            path = self._nodes.devices / f"video{self.device}"
        if not path.exists():
            raise self._not_there()
        if not os.access(path, os.R_OK | os.W_OK):
            hint = "Join the group that owns it: `sudo usermod -a -G video $USER`, then log in again."
            raise DeviceDenied(self.name, f"this user may not open {path}", hint)
        return str(path)

    def _not_there(self) -> DeviceError:
        listed = [f"{node.path} ({node.name})" for node in self._nodes.listed()]
        hint = f"There is: {', '.join(listed)}." if listed else "Plug it in; no camera at all is there now."
        return DeviceNotFound(self.name, f"there is no camera {str(self.device)!r}", hint)

    def _open(self) -> "_Webcam":
        node = self._node()
        target = self._target(node)
        # Read by OpenCV when it first waits in vain; ten seconds would be its own choice.
        os.environ.setdefault("OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT", "2")
        with opencv_quiet():
            capture = self._open_capture(target, self._backend.api)
        if not capture.isOpened():
            capture.release()
            raise self._refusal(target)
        try:
            self._ask_for_format(capture)
            ranges = control_ranges(target) if isinstance(target, str) else {}
            knobs = CaptureControls(self.name, capture, self._backend, ranges)
            webcam = _Webcam(self.name, capture, knobs, self._facts_of(capture, target, node))
            webcam.begin()
        except BaseException:
            capture.release()
            raise
        if node is not None:
            self._stable_path = node.stable_path
        return webcam

    def _refusal(self, target: int | str) -> DeviceError:
        if self._platform == "linux":
            return DeviceDenied(
                self.name,
                f"{target} does not open; another program uses it, or it is no camera",
                "Close the other program, or choose a camera that `turnscan devices` lists.",
            )
        problem = f"camera {target} does not open; it is not there, or another program uses it"
        return DeviceNotFound(self.name, problem, _PRIVACY.get(self._platform))

    def _ask_for_format(self, capture: Capture) -> None:
        """In this order: a format can limit the sizes, and a size the rates."""
        if self.fourcc:
            capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*self.fourcc.ljust(4)[:4]))
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, self.width)
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, self.height)
        capture.set(cv2.CAP_PROP_FPS, self.fps)
        capture.set(cv2.CAP_PROP_BUFFERSIZE, self.buffers)

    def _facts_of(self, capture: Capture, target: int | str, node: VideoNode | None) -> CameraFacts:
        fps = capture.get(cv2.CAP_PROP_FPS)
        name = node.name if node is not None else f"camera {target}"
        if node is not None and node.is_built_in:
            name = f"{name} (built into this computer)"
        place = str(node.stable_path if node is not None else target)
        return CameraFacts(name, place, (0, 0), fps if 0.0 < fps < 1000.0 else self.fps, False, False)


@dataclass(slots=True)
class _Webcam:
    """An open capture; used by its reading thread alone."""

    name: str
    capture: Capture
    knobs: CaptureControls
    facts: CameraFacts
    empty: int = 0

    def begin(self) -> None:
        """Let the camera's own JPEG through where it has any, and learn from a picture what really comes."""
        if int(self.capture.get(cv2.CAP_PROP_FOURCC)) == _MJPG:
            self.capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
            data = self._first_jpeg()
            if data is not None:
                self._learn(inspect(data).size, True)
                return
            self.capture.set(cv2.CAP_PROP_CONVERT_RGB, 1)
        picture = self._first()
        if picture.ndim not in (2, 3) or min(picture.shape[:2]) < 2:
            raise DeviceUnrecognised(self.name, "sends pictures in a format that cannot be read")
        self._learn((picture.shape[1], picture.shape[0]), False)

    def read(self) -> RawFrame | None:
        picture = self._picture()
        arrived_s = time.monotonic()
        if picture is None:
            self.empty += 1
            if self.empty >= _MOST_EMPTY or not _is_there(self.facts.place):
                raise DeviceLost(self.name, "sends no more pictures")
            time.sleep(_EMPTY_PAUSE_S)
            return None
        self.empty = 0
        exposure_us = self.knobs.exposure_us
        exposed_s = self._exposed_s(arrived_s, exposure_us) if self.facts.has_timestamps else None
        if not self.facts.gives_jpeg:
            return RawFrame(picture, exposed_s, exposure_us)
        return RawFrame(_jpeg_of(picture) or picture.tobytes(), exposed_s, exposure_us)

    def controls(self) -> Mapping[ControlName, Control]:
        return self.knobs.read()

    def set_control(self, name: ControlName, value: float | None) -> Control:
        return self.knobs.write(name, value)

    def interrupt(self) -> None:
        """OpenCV cannot be interrupted."""

    def close(self) -> None:
        self.capture.release()

    def _picture(self) -> Image | None:
        """What OpenCV read; it raises where it cannot undo a format that it was asked not to decode."""
        try:
            is_read, picture = self.capture.read()
        except cv2.error:
            return None
        return np.asarray(picture, np.uint8) if is_read and picture is not None and picture.size else None

    def _first_jpeg(self) -> bytes | None:
        """None where OpenCV decodes all the same. Cameras may begin with a few that are damaged."""
        for _ in range(_MOST_DAMAGED):
            picture = self._picture()
            if picture is None:
                time.sleep(_EMPTY_PAUSE_S)
            elif picture.size != max(picture.shape):
                return None
            elif (data := _jpeg_of(picture)) is not None:
                return data
        return None

    def _first(self) -> Image:
        deadline_s = time.monotonic() + _FIRST_PICTURE_S
        while True:
            picture = self._picture()
            if picture is not None:
                return picture
            if time.monotonic() > deadline_s:
                raise DeviceUnrecognised(
                    self.name,
                    "opens, but sends no picture",
                    "Try another USB socket, a smaller size or rate, or fourcc YUYV.",
                )
            time.sleep(_EMPTY_PAUSE_S)

    def _learn(self, size: tuple[int, int], gives_jpeg: bool) -> None:
        stamp_s = self.capture.get(cv2.CAP_PROP_POS_MSEC) / 1000.0
        has_timestamps = 0.0 <= time.monotonic() - stamp_s < _OLDEST_S
        self.facts = replace(self.facts, size=size, has_timestamps=has_timestamps, gives_jpeg=gives_jpeg)

    def _exposed_s(self, arrived_s: float, exposure_us: float | None) -> float | None:
        """The kernel stamps a picture when its first line is sent, and that is when it has been exposed.

        An exposure that is not known has lasted one period at most.
        """
        stamp_s = self.capture.get(cv2.CAP_PROP_POS_MSEC) / 1000.0
        if not 0.0 <= arrived_s - stamp_s < _OLDEST_S:
            return None
        return stamp_s - (1.0 / self.facts.fps if exposure_us is None else exposure_us / 1e6)


def _backend_of(name: str, platform: str) -> Backend:
    name = name or _SYSTEM_BACKENDS.get(platform, "v4l2")
    if name not in BACKENDS:
        raise OptionError(
            f"There is no way to reach cameras called {name!r}.", f"Choose one of: {', '.join(BACKENDS)}."
        )
    return BACKENDS[name]


def _is_there(place: str) -> bool:
    return not place.startswith("/") or Path(place).exists()


def _jpeg_of(picture: Image) -> bytes | None:
    """The JPEG that an array of bytes holds; None where it holds none."""
    try:
        return whole_jpeg(picture.tobytes())
    except ValueError:
        return None


CAMERAS.register("uvc", UvcCamera)
