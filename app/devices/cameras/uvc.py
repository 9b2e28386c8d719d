"""A webcam or any other camera that the system gives to programs, captured by OpenCV."""

import os
import sys
from collections.abc import Callable
from pathlib import Path

import cv2

from app.devices.camera_driver import CAMERAS, CameraFacts
from app.devices.capture_controls import BACKENDS, Backend, Capture, CaptureControls
from app.devices.opencv_quiet import opencv_quiet
from app.devices.read_ahead_camera import ReadAheadCamera
from app.devices.video_nodes import VideoNode, VideoNodes, control_ranges
from app.devices.webcam import Webcam
from app.errors import DeviceDenied, DeviceError, DeviceNotFound, OptionError

_OPEN_S = 15.0
_SYSTEM_BACKENDS = {"linux": "v4l2", "win32": "msmf", "darwin": "avfoundation"}
_PRIVACY = {
    "win32": "Allow programs to use the camera in Settings, Privacy, and close others that use it.",
    "darwin": "Allow the terminal to use the camera in System Settings, Privacy; close others that use it.",
}


class UvcCamera(ReadAheadCamera[Webcam]):
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

    def _open(self) -> Webcam:
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
            webcam = Webcam(self.name, capture, knobs, self._facts_of(capture, target, node))
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


def _backend_of(name: str, platform: str) -> Backend:
    name = name or _SYSTEM_BACKENDS.get(platform, "v4l2")
    if name not in BACKENDS:
        raise OptionError(
            f"There is no way to reach cameras called {name!r}.", f"Choose one of: {', '.join(BACKENDS)}."
        )
    return BACKENDS[name]


CAMERAS.register("uvc", UvcCamera)
