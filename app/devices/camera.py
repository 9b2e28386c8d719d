"""A camera as the bench uses it: a thread grabs all the time, and whoever wants frames gets fresh ones."""

import contextlib
import math
import threading
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from app.devices.camera_controls import CameraSettings as CameraSettings
from app.devices.camera_controls import WantedControls
from app.devices.camera_driver import CameraDriver, CameraFacts, Control, ControlName
from app.devices.frame import Frame, Mounting, Rotation, Use
from app.devices.frame_stream import FrameStream
from app.devices.intake import Intake
from app.errors import DeviceError, DeviceLost, DeviceTimeout

# A camera that has sent nothing new for so long, or for so many periods if those are longer, is frozen.
_PATIENCE_S = 0.9
_PATIENCE_PERIODS = 4.0
# The first picture takes longer: the sensor starts, and automatics look for their values. So may the next, as
# long as nobody knows the rate.
_START_PATIENCE_S = 5.0
# How long the thread waits at a time, so that `disconnect` need not wait long.
_SLICE_S = 0.25
_PAUSES_S = (0.1, 0.2, 0.4, 0.8, 1.0)
_FRESH_TIMEOUT_S = 5.0
# How long a thread may take to let go of its camera.
_FAREWELL_S = 10.0


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

    is_connected: bool = False
    is_frozen: bool = False
    frames: int = 0
    fps: float = 0.0
    lost: int = 0
    repeated: int = 0
    reopened: int = 0
    last_error: str = ""


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
        self._controls = WantedControls(driver, self._check_open, self._settle)
        self._streams: list[FrameStream] = []
        self._thread: threading.Thread | None = None
        self._is_opening = self._is_given_up = False
        self._closing = threading.Event()
        self._intake: Intake | None = None
        self._latest: Frame | None = None
        self._is_open, self._reopened, self._last_error = False, 0, ""
        self._new_s = self._settled_s = -math.inf

    @property
    def facts(self) -> CameraFacts:
        """What the camera is, with the size of upright pictures; known once connected."""
        return self._known.facts

    @property
    def state(self) -> CameraState:
        with self._changed:
            intake = self._intake
            if intake is None:
                return CameraState()
            is_silent = time.monotonic() - self._new_s > self._patience_s()
            return CameraState(
                self._is_open, self._is_open and is_silent, intake.frames, intake.fps, intake.lost,
                intake.repeated, self._reopened, self._last_error,
            )  # fmt: skip

    def connect(self) -> None:
        """Open the camera and begin to grab. Does nothing where that is done.

        Raises:
            DeviceError: or one of its children, when it cannot be opened.
        """
        with self._life_lock:
            if self._thread is not None:
                return
            self._open()
            with self._changed:
                self._intake = Intake(self.name, self.driver.facts, self.mounting, self.latency_s)
                self._closing = threading.Event()
                self._latest, self._reopened, self._last_error = None, 0, ""
                self._new_s, self._is_open = time.monotonic(), True
            self._thread = threading.Thread(target=self._run, name=f"{self.name}-grab", daemon=True)
            self._thread.start()

    def disconnect(self) -> None:
        """Stop grabbing and let go of the camera. Streams end. Never fails, nor waits for who opens it."""
        with self._changed:
            self._is_given_up = self._is_opening
            if self._is_opening:
                # That may take long; whoever does it lets go.
                return
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
                if frame is not None and self._known.surely_began_s(frame) >= max(wanted_s, self._settled_s):
                    return frame
                left_s = deadline_s - time.monotonic()
                if left_s <= 0.0:
                    break
                self._changed.wait(left_s)
            if not self._is_open:
                raise DeviceLost(self.name, f"has gone and did not come back ({self._last_error})")
            hint = "Check that the camera delivers pictures, and its cable."
            raise DeviceTimeout(self.name, "a fresh frame", timeout_s, hint)

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
        return self._controls.read()

    def set_control(self, name: ControlName, value: float | None) -> Control:
        """Ask for a value, or with None for the camera's own automatic; return what the camera made of it.

        Raises:
            DeviceRefused: the camera has no such control.
            DeviceLost: the camera is away; the value is written when it is back.
        """
        return self._controls.write(name, value)

    def prepare(self, use: Use, *, exposure_us: float | None = None) -> None:
        """Set the controls for pictures of one use: what differs from now and what the camera has.

        Args:
            use: see there.
            exposure_us: instead of the one that its settings name.
        """
        controls = dict(self.settings[use].controls) if use in self.settings else {}
        if exposure_us is not None:
            controls[ControlName.EXPOSURE] = exposure_us
        self._controls.apply(CameraSettings(controls))

    def _open(self) -> None:
        with self._changed:
            self._is_opening, self._is_given_up = True, False
        try:
            self.driver.connect()
        finally:
            with self._changed:
                self._is_opening = False
        if self._is_given_up:
            self.driver.disconnect()
            raise self._not_connected()

    @property
    def _known(self) -> Intake:
        if self._intake is None:
            raise self._not_connected()
        return self._intake

    def _run(self) -> None:
        closing = self._closing
        self._write_controls()
        while not closing.is_set():
            try:
                self._grab()
            except DeviceError as error:
                self._reopen(error.problem)
            except Exception as error:  # noqa: BLE001 (edge of a thread: a driver that breaks is reopened too)
                self._reopen(f"its driver failed ({error!r})")
        self.driver.disconnect()

    def _grab(self) -> None:
        """One picture, or a check that the camera is not silent for too long."""
        left_s = self._new_s + self._patience_s() - time.monotonic()
        if left_s <= 0.0:
            raise DeviceLost(self.name, self._known.flaw)
        try:
            raw = self.driver.grab(min(left_s, _SLICE_S))
        except DeviceTimeout:
            return
        arrived_s = time.monotonic() if raw.arrived_s is None else raw.arrived_s
        with self._changed:
            frame = self._known.take(raw, arrived_s)
            if frame is None:
                return
            self._latest, self._new_s = frame, time.monotonic()
            for stream in self._streams:
                stream.add(frame)
            self._changed.notify_all()

    def _reopen(self, problem: str) -> None:
        """Close the camera and try until it is back with pictures of the same size, or nobody wants it."""
        closing = self._closing
        with self._changed:
            self._is_open, self._last_error = False, problem
            for stream in self._streams:
                stream.lose(problem)
            self._changed.notify_all()
        attempt = 0
        while not closing.is_set():
            self.driver.disconnect()
            if closing.wait(_PAUSES_S[min(attempt, len(_PAUSES_S) - 1)]):
                return
            attempt += 1
            try:
                self.driver.connect()
                self._known.reopen(self.driver.facts)
            except DeviceError as error:
                self._note(error.problem)
            except ValueError as error:
                self._note(str(error))
            else:
                self._go_on()
                return

    def _go_on(self) -> None:
        self._write_controls()
        with self._changed:
            if self._closing.is_set():
                return
            self._is_open, self._new_s = True, time.monotonic()
            self._reopened += 1
            for stream in self._streams:
                stream.find()
            self._changed.notify_all()

    def _write_controls(self) -> None:
        refused = self._controls.write_again()
        if refused:
            self._note(refused)

    def _note(self, problem: str) -> None:
        with self._changed:
            self._last_error = problem

    def _settle(self) -> None:
        """Sensors take over a new value one picture late, and that one is under way."""
        with self._changed:
            self._settled_s = time.monotonic() + self._known.period_s

    def _patience_s(self) -> float:
        intake = self._known
        patience_s = max(_PATIENCE_S, _PATIENCE_PERIODS * intake.period_s + self._controls.exposure_s)
        return patience_s if intake.is_paced else max(patience_s, _START_PATIENCE_S)

    def _check_connected(self) -> None:
        if self._thread is None or self._closing.is_set():
            raise self._not_connected()

    def _check_open(self) -> None:
        self._check_connected()
        if not self._is_open:
            raise DeviceLost(self.name, f"is away ({self._last_error})")

    def _not_connected(self) -> DeviceError:
        return DeviceError(self.name, "is not connected", "Connect it first.")
