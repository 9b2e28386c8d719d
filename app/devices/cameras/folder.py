"""A camera that shows what was taken before: a recording, a folder of pictures, or a video."""

import time
from collections.abc import Callable, Mapping
from pathlib import Path

from app.devices.camera_controls import lacks
from app.devices.camera_driver import CAMERAS, CameraFacts, Control, ControlName, Picture, RawFrame
from app.devices.playback import FolderRoll, RecordedRoll, Roll, VideoRoll
from app.errors import DeviceError, DeviceLost, DeviceNotFound, DeviceTimeout, OptionError, ScannerError
from app.recording.journal import JOURNAL_FILE, MANIFEST_FILE
from app.recording.picture import inspect
from app.recording.reader import Recording
from app.recording.shot import Role

_HINT = "Name a folder with a recording or with pictures, or a video file."


class FolderCamera:
    """Pictures in order, at a steady rate; or, where it is told how the table stands, those that fit.

    Its pictures are taken to be exposed when they are due.

    Attributes:
        folder: a recording, a folder of pictures, or a video file.
        name: what messages call it.
        fps: pictures per second.
        role: only frames of this role; empty for all. For a recording.
        repeats: whether the first follows the last; else the camera is lost after the last.
        ask: gives the table's angle, degrees as the recording counts it, and the lasers that are lit; each
            picture is then the recorded one that fits best. For a recording.
    """

    def __init__(
        self,
        folder: str | Path,
        *,
        name: str = "camera",
        fps: float = 10.0,
        role: str = "",
        repeats: bool = True,
        ask: Callable[[], tuple[float, tuple[str, ...]]] | None = None,
    ) -> None:
        self.path, self.name, self.fps, self.repeats = Path(folder), name, fps, repeats
        self._role, self._ask = _role_of(role), ask
        self._roll: Roll | None = None
        self._facts: CameraFacts | None = None
        self._number = 0
        self._due_s = 0.0

    @property
    def facts(self) -> CameraFacts:
        if self._facts is None:
            raise self._not_connected()
        return self._facts

    def connect(self) -> None:
        self.disconnect()
        try:
            roll = self._open()
            if not len(roll):
                raise DeviceNotFound(self.name, f"{self.path} holds no picture", _HINT)
            first = roll.picture(0)
            size, gives_jpeg = _size_of(first)
        except DeviceError:
            raise
        except ScannerError as error:
            raise DeviceNotFound(self.name, error.message, error.hint) from error
        except (OSError, ValueError) as error:
            raise DeviceNotFound(self.name, f"{self.path} {error}", _HINT) from error
        self._facts = CameraFacts("recorded pictures", str(self.path), size, self.fps, True, gives_jpeg)
        self._roll, self._number, self._due_s = roll, 0, time.monotonic()

    def disconnect(self) -> None:
        self._roll = None

    def grab(self, timeout_s: float) -> RawFrame:
        roll = self._opened()
        if self._number >= len(roll) and not self.repeats:
            raise DeviceLost(self.name, f"{self.path} has no more pictures", "Connect again to start anew.")
        wait_s = self._due_s - time.monotonic()
        time.sleep(max(0.0, min(wait_s, timeout_s)))
        if wait_s > timeout_s:
            raise DeviceTimeout(self.name, "a picture", timeout_s)
        exposed_s = max(self._due_s, time.monotonic() - 1.0 / self.fps)
        self._due_s = exposed_s + 1.0 / self.fps
        number = self._number % len(roll)
        if self._ask is not None and isinstance(roll, RecordedRoll):
            number = roll.nearest(*self._ask())
        else:
            self._number += 1
        try:
            data = roll.picture(number)
        except (OSError, ScannerError) as error:
            raise DeviceLost(self.name, f"{self.path} has gone", "Put it back.") from error
        exposure_us = roll.entry(number).exposure_us if isinstance(roll, RecordedRoll) else None
        # Given as a function, because a picture that comes again is no sign of a frozen camera here.
        return RawFrame(lambda: data, exposed_s, exposure_us)

    def controls(self) -> Mapping[ControlName, Control]:
        self._opened()
        return {}

    def set_control(self, name: ControlName, value: float | None) -> Control:
        self._opened()
        raise lacks(self.name, name)

    def _open(self) -> Roll:
        if not self.path.exists():
            raise DeviceNotFound(self.name, f"there is nothing at {self.path}", _HINT)
        home = self.path.parent if self.path.name in (MANIFEST_FILE, JOURNAL_FILE) else self.path
        if any((home / file).is_file() for file in (MANIFEST_FILE, JOURNAL_FILE)):
            return RecordedRoll(Recording.open(home), self._role)
        return FolderRoll(home) if home.is_dir() else VideoRoll(home)

    def _opened(self) -> Roll:
        if self._roll is None:
            raise self._not_connected()
        return self._roll

    def _not_connected(self) -> DeviceError:
        return DeviceLost(self.name, "is not connected")


def _role_of(role: str) -> Role | None:
    if not role:
        return None
    try:
        return Role(role)
    except ValueError:
        known = ", ".join(r.value for r in Role)
        raise OptionError(f"There is no role {role!r}.", f"Choose one of: {known}.") from None


def _size_of(picture: Picture) -> tuple[tuple[int, int], bool]:
    """Width and height, and whether it is JPEG."""
    if isinstance(picture, bytes):
        facts = inspect(picture)
        return facts.size, facts.format == "jpeg"
    return (picture.shape[1], picture.shape[0]), False


CAMERAS.register("folder", FolderCamera)
