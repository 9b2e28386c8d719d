"""The camera of the simulated world: exposes on its own beat, renders when somebody looks."""

import math
import threading
import time
from collections import deque
from collections.abc import Mapping
from dataclasses import replace

from app.devices.camera_driver import CAMERAS, CameraFacts, Control, ControlName, Picture, RawFrame
from app.devices.studio import Studio
from app.errors import DeviceLost, DeviceNotFound, DeviceRefused, DeviceTimeout
from app.recording.picture import encode
from app.simulation.exposure import SensorSettings
from app.simulation.history import History
from app.simulation.stage import Moment
from app.simulation.world import SimulatedWorld

# A reader that comes back within this time has lost nothing; later it counts as having been away.
_QUEUE_S = 0.25
_SETTINGS_KEPT_S = 20.0
_SHORTEST_US = 50.0
# From so many pixels on, rendering takes longer than it takes to ask another process for it.
_LARGE_PX = 300_000
_FIELDS = {
    ControlName.EXPOSURE: "exposure_us",
    ControlName.GAIN: "gain",
    ControlName.WHITE_BALANCE: "white_balance_k",
    ControlName.FOCUS: "focus",
}
_RANGES = {
    ControlName.GAIN: (1.0, 16.0),
    ControlName.WHITE_BALANCE: (2500.0, 9000.0),
    ControlName.FOCUS: (0.0, 255.0),
}


class SimulatedCamera:
    """Sees the simulated world. Its latency, stale pictures and lack of time stamps are the world's plan.

    Large pictures are made in a process of their own, see `Studio`.

    Attributes:
        world: what it looks at.
    """

    def __init__(self, world: SimulatedWorld) -> None:
        self.world = world
        self._fps = world.plan.fps
        self._changed = threading.Condition()
        self._settings = History(SensorSettings(), _SETTINGS_KEPT_S)
        self._automatic: set[ControlName] = set()
        self._stale: deque[int] = deque()
        self._next = 0
        self._studio: Studio | None = None
        self._is_connected = self._is_unplugged = self._is_frozen = False

    @property
    def facts(self) -> CameraFacts:
        plan = self.world.plan
        return CameraFacts(
            "simulated camera", "simulated", (plan.width, plan.height), plan.fps * plan.rate,
            plan.has_timestamps, gives_jpeg=True,
        )  # fmt: skip

    def connect(self) -> None:
        # No picture shall be late once they come.
        if not self._has_studio():
            self.world.stage.rehearse()
        with self._changed:
            if self._is_unplugged:
                raise DeviceNotFound("camera", "the simulated camera is unplugged")
            self._is_connected, self._is_frozen = True, False
            self._stale.clear()
            self._next = self._coming()

    def _has_studio(self) -> bool:
        plan = self.world.plan
        if plan.width * plan.height < _LARGE_PX:
            return False
        if self._studio is None:
            self._studio = Studio(plan)
            self.world.at_close(self._studio.close)
        return self._studio.is_open

    def disconnect(self) -> None:
        with self._changed:
            self._is_connected = False
            self._changed.notify_all()

    def grab(self, timeout_s: float) -> RawFrame:
        ends_s = time.monotonic() + timeout_s
        with self._changed:
            while True:
                self._check()
                self._catch_up()
                number = self._stale[0] if self._stale else self._next
                ready_s = self.world.clock.monotonic_s(self._ready_s(number))
                wait_s = min(ready_s, ends_s) - time.monotonic()
                if not self._is_frozen and wait_s <= 0.0 and ready_s <= ends_s:
                    return self._taken(number)
                if self._is_frozen:
                    wait_s = ends_s - time.monotonic()
                if wait_s <= 0.0:
                    raise DeviceTimeout("camera", "a picture", timeout_s)
                self._changed.wait(wait_s)

    def controls(self) -> Mapping[ControlName, Control]:
        with self._changed:
            self._check()
            return {name: self._control(name) for name in _FIELDS}

    def set_control(self, name: ControlName, value: float | None) -> Control:
        with self._changed:
            self._check()
            if name not in _FIELDS:
                raise DeviceRefused("camera", f"has no control for {name.replace('_', ' ')}")
            if value is not None and not math.isfinite(value):
                raise DeviceRefused("camera", f"{name.replace('_', ' ')} cannot be {value:g}")
            if value is None:
                self._automatic.add(name)
                chosen = self._by_itself(name)
            else:
                self._automatic.discard(name)
                lowest, highest = self._range(name)
                chosen = min(max(value, lowest), highest)
            self._settings.change(
                replace(self._settings.last, **{_FIELDS[name]: chosen}), self.world.clock.now_s()
            )
            return self._control(name)

    def unplug(self) -> None:
        """A fault: it is gone until `plug_in`."""
        with self._changed:
            self._is_unplugged = True
            self._changed.notify_all()

    def plug_in(self) -> None:
        with self._changed:
            self._is_unplugged = False

    def freeze(self) -> None:
        """A fault: nothing comes any more, until it is opened again."""
        with self._changed:
            self._is_frozen = True

    def _check(self) -> None:
        if self._is_unplugged:
            self._is_connected = False
            raise DeviceLost("camera", "is gone")
        if not self._is_connected:
            raise DeviceLost("camera", "is not connected")

    def _catch_up(self) -> None:
        """A reader that was away finds the oldest pictures that the camera kept, then the coming one."""
        clock = self.world.clock
        late_s = time.monotonic() - clock.monotonic_s(self._ready_s(self._next))
        if self._stale or self._is_frozen or late_s <= _QUEUE_S:
            return
        coming = self._coming()
        self._stale.extend(range(self._next, min(self._next + self.world.plan.stale_frames, coming)))
        self._next = coming

    def _taken(self, number: int) -> RawFrame:
        if self._stale:
            self._stale.popleft()
        else:
            self._next = number + 1
        start_s = number / self._fps
        settings = self._settings.at(start_s)
        moment = self.world.moment(start_s, settings)
        exposed_s = self.world.clock.monotonic_s(start_s) if self.world.plan.has_timestamps else None
        return RawFrame(lambda: self._file(moment, settings), exposed_s, settings.exposure_us)

    def _file(self, moment: Moment, settings: SensorSettings) -> Picture:
        studio = self._studio
        if studio is not None:
            if studio.is_closed:
                raise DeviceLost("camera", "was put away before it had made this picture")
            if file := studio.picture(moment, settings):
                return file
        return encode(self.world.stage.picture(moment, settings), "jpeg", self.world.plan.jpeg_quality)

    def _coming(self) -> int:
        """Number of the picture whose exposure begins next."""
        return math.floor(self.world.clock.now_s() * self._fps) + 1

    def _ready_s(self, number: int) -> float:
        """World time at which a picture arrives."""
        start_s = number / self._fps
        exposure_s = 1e-6 * self._settings.at(start_s).exposure_us
        return start_s + exposure_s + self.world.plan.camera_latency_s

    def _control(self, name: ControlName) -> Control:
        value = float(getattr(self._settings.last, _FIELDS[name]))
        return Control(name, value, *self._range(name), is_automatic=name in self._automatic)

    def _range(self, name: ControlName) -> tuple[float, float]:
        return _RANGES.get(name, (_SHORTEST_US, 1e6 / self._fps))

    def _by_itself(self, name: ControlName) -> float:
        """What its automatics find; exposure goes by the room, lasers are too small to count."""
        value = float(getattr(SensorSettings(), _FIELDS[name]))
        if name is ControlName.EXPOSURE:
            value /= max(self.world.light, 1e-3)
        lowest, highest = self._range(name)
        return min(max(value, lowest), highest)


CAMERAS.register("simulated", SimulatedCamera)
