"""A camera as the bench uses it: a thread grabs all the time, and whoever wants frames gets fresh ones."""

import contextlib
import threading
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

from app.devices.camera_driver import CameraDriver, CameraFacts, Control, ControlName, RawFrame
from app.devices.frame import Frame, LazyPicture, Mounting, Rotation, Use
from app.devices.frame_stream import FrameStream
from app.devices.rhythm import Repeats, Rhythm
from app.errors import DeviceError, DeviceLost, DeviceTimeout
from app.recording.picture import inspect

# A camera that has sent nothing new for so long, or for so many periods if those are longer, is frozen.
_PATIENCE_S = 0.9
_PATIENCE_PERIODS = 4.0
# The first picture takes longer: the sensor starts, and automatics look for their values.
_START_PATIENCE_S = 5.0
_PAUSES_S = (0.1, 0.2, 0.4, 0.8, 1.0)
_FRESH_TIMEOUT_S = 5.0
# How long a thread may take to let go of its camera.
_FAREWELL_S = 10.0
# How long the thread waits at a time, so that `disconnect` need not wait long.
_SLICE_S = 0.25
# A time stamp further back than this is of another clock.
_OLDEST_S = 10.0
_SILENT = "is frozen: it sends no pictures"


@dataclass(frozen=True, slots=True)
class CameraSettings:
    """What the controls are to be while pictures of one use are taken.

    Attributes:
        controls: value of each control, in the units of `ControlName`; None for the camera's own automatic.
    """

    controls: Mapping[ControlName, float | None] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class CameraState:
    """How a camera is doing.

    Attributes:
        is_connected: whether it is open; not while it is being reopened.
        is_frozen: it is open, but nothing new has come for too long.
        frames: pictures that came since `connect`.
        fps: pictures per second lately; 0 before there are enough.
        lost: pictures that came damaged or, by the times of the others, not at all.
        repeated: pictures that were the one before once more, and were left out.
        reopened: how many times it went away and came back.
        last_error: what was wrong most recently; empty while nothing has been.
    """

    is_connected: bool
    is_frozen: bool
    frames: int
    fps: float
    lost: int
    repeated: int
    reopened: int
    last_error: str


class Camera:
    """A driver with the thread that keeps it.

    A camera that goes silent, sends the same picture for ever or vanishes is noticed within a second, closed,
    and opened again until it works or `disconnect` is called; its controls are written again. Every method
    may be called from any thread.

    Args:
        driver: the camera as it is.
        name: what messages call it.
        rotation: degrees clockwise that make its pictures upright.
        is_mirrored: whether left and right are then exchanged.
        latency_s: from the beginning of an exposure to the arrival of its picture, as measured; used where
            the camera does not tell when it exposed.
        settings: of each use.
    """

    def __init__(
        self,
        driver: CameraDriver,
        *,
        name: str = "camera",
        rotation: Rotation = 0,
        is_mirrored: bool = False,
        latency_s: float = 0.0,
        settings: Mapping[Use, CameraSettings] | None = None,
    ) -> None:
        self.driver, self.name, self.latency_s = driver, name, latency_s
        self.mounting = Mounting(rotation, is_mirrored)
        self.settings = dict(settings or {})
        self._changed = threading.Condition()
        self._life_lock = threading.Lock()
        self._controls_lock = threading.RLock()
        self._asked: dict[ControlName, float | None] = {}
        self._streams: list[FrameStream] = []
        self._thread: threading.Thread | None = None
        self._closing = threading.Event()
        self._facts: CameraFacts | None = None
        self._begin()

    @property
    def facts(self) -> CameraFacts:
        """What the camera is, with the size of upright pictures; known once connected."""
        if self._facts is None:
            raise self._not_connected()
        return replace(self._facts, size=self.mounting.size(self._facts.size))

    @property
    def state(self) -> CameraState:
        with self._changed:
            silent_s = time.monotonic() - self._new_s
            return CameraState(
                self._is_open, self._is_open and silent_s > self._patience_s(), self._frames,
                self._rhythm.fps, self._damaged + self._rhythm.missing, self._repeated, self._reopened,
                self._last_error,
            )  # fmt: skip

    def connect(self) -> None:
        """Open the camera and begin to grab. Does nothing where that is done.

        Raises:
            DeviceError: or one of its children, when it cannot be opened.
        """
        with self._life_lock:
            if self._thread is not None:
                return
            self.driver.connect()
            self._closing = threading.Event()
            with self._changed:
                self._begin()
                self._facts, self._is_open = self.driver.facts, True
            self._thread = threading.Thread(target=self._run, name=f"{self.name}-grab", daemon=True)
            self._thread.start()

    def disconnect(self) -> None:
        """Stop grabbing and let go of the camera. Streams end. Never fails."""
        with self._life_lock:
            if self._thread is None:
                return
            self._closing.set()
            with self._changed:
                self._is_open = False
                for stream in self._streams:
                    stream.end()
                self._changed.notify_all()
            self._thread.join(_FAREWELL_S)
            self._thread = None

    def latest(self) -> Frame | None:
        """The newest frame, at once; None before the first."""
        return self._latest

    def fresh_frame(self, *, after_s: float | None = None, timeout_s: float = _FRESH_TIMEOUT_S) -> Frame:
        """A frame whose exposure began after this call, with the controls as they were last set.

        Where the camera does not tell when it exposed, a frame counts that arrived its latency and one
        period later.

        Args:
            after_s: monotonic time instead of that of the call.
            timeout_s: how long to wait; a camera that is being reopened is waited for.

        Raises:
            DeviceLost: the camera has gone and not come back in time.
            DeviceTimeout: it is there, but gave no fresh frame in time.
        """
        now_s = time.monotonic()
        deadline_s, wanted_s = now_s + timeout_s, now_s if after_s is None else after_s
        with self._changed:
            while True:
                self._check_connected()
                frame = self._latest
                if frame is not None and self._surely_began_s(frame) >= max(wanted_s, self._settled_s):
                    return frame
                left_s = deadline_s - time.monotonic()
                if left_s <= 0.0:
                    break
                self._changed.wait(left_s)
            if not self._is_open:
                raise DeviceLost(self.name, f"has gone and did not come back ({self._last_error})")
            raise DeviceTimeout(
                self.name,
                "a fresh frame",
                timeout_s,
                "Check that the camera delivers pictures, and its cable.",
            )

    @contextlib.contextmanager
    def stream(self, most: int = 600, *, patience_s: float | None = None) -> Iterator[FrameStream]:
        """Every frame from now on, in order.

        Args:
            most: how many wait for the reader before the oldest is dropped and counted.
            patience_s: raise DeviceLost in the reader once the camera has been gone for so long; None waits
                until it is back, however long that takes.
        """
        with self._changed:
            self._check_connected()
            stream = FrameStream(self.name, most, patience_s)
            if not self._is_open:
                stream.lose(self._last_error)
            self._streams.append(stream)
        try:
            yield stream
        finally:
            stream.end()
            with self._changed:
                self._streams.remove(stream)

    def controls(self) -> Mapping[ControlName, Control]:
        """The controls that this camera has, as they are now."""
        with self._controls_lock:
            self._check_open()
            return self.driver.controls()

    def set_control(self, name: ControlName, value: float | None) -> Control:
        """Ask for a value, or with None for the camera's own automatic; return what the camera made of it.

        Raises:
            DeviceRefused: the camera has no such control.
            DeviceLost: the camera is away; the value is written when it is back.
        """
        with self._controls_lock:
            self._asked[name] = value
            self._check_open()
            try:
                control = self.driver.set_control(name, value)
            except DeviceError as error:
                if not isinstance(error, DeviceLost | DeviceTimeout):
                    del self._asked[name]
                raise
            self._settle()
            return control

    def prepare(self, use: Use) -> None:
        """Set the controls for pictures of one use: what differs from now and what the camera has."""
        wanted = self.settings.get(use, CameraSettings()).controls
        with self._controls_lock:
            differing = {n: v for n, v in wanted.items() if n not in self._asked or self._asked[n] != v}
            if not differing:
                return
            present = self.controls()
            for name, value in differing.items():
                if name in present:
                    self.set_control(name, value)

    def _begin(self) -> None:
        """Forget the frames of an earlier connection."""
        self._latest: Frame | None = None
        self._rhythm, self._repeats = Rhythm(), Repeats()
        self._frames = self._damaged = self._repeated = self._reopened = 0
        self._last_error = ""
        self._is_open = False
        self._settled_s = -float("inf")
        self._new_s = time.monotonic()
        self._has_begun, self._flaw = False, _SILENT

    def _run(self) -> None:
        closing = self._closing
        self._write_controls()
        while not closing.is_set():
            try:
                self._grab()
            except DeviceError as error:
                self._reopen(error)
            except Exception as error:  # noqa: BLE001 (edge of a thread: a driver that breaks is reopened too)
                self._reopen(DeviceError(self.name, f"its driver failed ({error!r})"))
        self.driver.disconnect()

    def _grab(self) -> None:
        """One picture, or a check that the camera is not silent for too long."""
        left_s = self._new_s + self._patience_s() - time.monotonic()
        if left_s <= 0.0:
            raise DeviceLost(self.name, self._flaw)
        with contextlib.suppress(DeviceTimeout):
            self._take(self.driver.grab(min(left_s, _SLICE_S)))

    def _take(self, raw: RawFrame) -> None:
        """Count a picture and hand it on, unless it is damaged or came before."""
        arrived_s = time.monotonic()
        assert self._facts is not None
        if isinstance(raw.data, bytes) and not _is_whole(raw.data, self._facts.size):
            with self._changed:
                self._damaged += 1
                self._flaw = "sends nothing but damaged pictures"
            return
        if self._repeats.is_repeat(raw.data):
            with self._changed:
                self._repeated += 1
                self._flaw = "is frozen: it sends the same picture again and again"
            return
        exposed_s, is_timed = arrived_s - self.latency_s, False
        if raw.exposed_s is not None and arrived_s - _OLDEST_S < raw.exposed_s <= arrived_s:
            exposed_s, is_timed = raw.exposed_s, True
        with self._changed:
            frame = Frame(
                self._frames, self.mounting.size(self._facts.size), exposed_s, arrived_s, raw.exposure_us,
                is_timed,
                LazyPicture(raw, self._facts.size, self.mounting, f"{self.name} frame {self._frames}"),
            )  # fmt: skip
            self._frames += 1
            self._rhythm.add(frame.exposed_s, is_timed)
            self._latest, self._new_s, self._has_begun, self._flaw = frame, arrived_s, True, _SILENT
            for stream in self._streams:
                stream.add(frame)
            self._changed.notify_all()

    def _reopen(self, error: DeviceError) -> None:
        """Close the camera and try until it is back with pictures of the same size, or nobody wants it."""
        closing = self._closing
        if closing.is_set():
            return
        with self._changed:
            self._is_open, self._last_error = False, str(error)
            for stream in self._streams:
                stream.lose(str(error))
            self._changed.notify_all()
        attempt = 0
        while not closing.is_set():
            self.driver.disconnect()
            if closing.wait(_PAUSES_S[min(attempt, len(_PAUSES_S) - 1)]):
                return
            attempt += 1
            try:
                self._open_again()
            except DeviceError as again:
                with self._changed:
                    self._last_error = str(again)
            else:
                return

    def _open_again(self) -> None:
        self.driver.connect()
        facts = self.driver.facts
        assert self._facts is not None
        if facts.size != self._facts.size:
            sizes = "{} x {} pixels instead of {} x {}".format(*facts.size, *self._facts.size)
            raise DeviceError(
                self.name, f"came back with {sizes}", "Close the program that changed it, or connect again."
            )
        self._write_controls()
        with self._changed:
            self._facts, self._is_open = facts, True
            self._has_begun, self._flaw, self._new_s = False, _SILENT, time.monotonic()
            self._reopened += 1
            self._rhythm.pause()
            self._repeats = Repeats()
            for stream in self._streams:
                stream.find()
            self._changed.notify_all()

    def _write_controls(self) -> None:
        """Everything that was ever asked for; a control that the camera no longer takes is left alone."""
        with self._controls_lock:
            for name, value in self._asked.items():
                try:
                    self.driver.set_control(name, value)
                except DeviceError as error:
                    with self._changed:
                        self._last_error = str(error)
            if self._asked:
                self._settle()

    def _settle(self) -> None:
        """Sensors take over a new value one picture late, and that one is under way."""
        with self._changed:
            self._settled_s = time.monotonic() + self._period_s()

    def _surely_began_s(self, frame: Frame) -> float:
        return frame.exposed_s if frame.is_timed else frame.exposed_s - self._period_s()

    def _period_s(self) -> float:
        announced = self._facts.fps if self._facts is not None else 0.0
        fps = self._rhythm.fps or announced
        return 1.0 / fps if fps > 0.0 else 1.0 / 30.0

    def _patience_s(self) -> float:
        exposure_s = (self._asked.get(ControlName.EXPOSURE) or 0.0) / 1e6
        patience_s = max(_PATIENCE_S, _PATIENCE_PERIODS * self._period_s() + exposure_s)
        return patience_s if self._has_begun else max(patience_s, _START_PATIENCE_S)

    def _check_connected(self) -> None:
        if self._thread is None or self._closing.is_set():
            raise self._not_connected()

    def _check_open(self) -> None:
        self._check_connected()
        if not self._is_open:
            raise DeviceLost(self.name, f"is away ({self._last_error})")

    def _not_connected(self) -> DeviceError:
        return DeviceError(self.name, "is not connected", "Connect it first.")


def _is_whole(data: bytes, size: tuple[int, int]) -> bool:
    try:
        return inspect(data).size == size
    except ValueError:
        return False
