"""The bench: the camera and the controller board that we own, for one job at a time."""

import contextlib
import inspect
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from types import TracebackType
from typing import Any, Self
from uuid import uuid4

from app.devices.bench_file import BenchDescription, CameraEntry, DriverEntry, LaserEntry
from app.devices.camera import Camera, CameraSettings, CameraState
from app.devices.camera_driver import CAMERAS
from app.devices.frame import Use
from app.devices.turntable import TURNTABLES, Turntable
from app.devices.watchdog import Watchdog
from app.documents import Json
from app.errors import (
    BenchBusy,
    BenchFileError,
    DeviceError,
    DeviceLost,
    MoveStopped,
    OptionError,
    PositionUnknown,
)
from app.registry import Registry
from app.simulation.world import SimulatedWorld, WorldPlan

_LEASE_WAIT_S = 5.0
# By then a board has stopped, or never will.
_LONGEST_STOP_S = 10.0


@dataclass(frozen=True, slots=True)
class BenchSnapshot:
    """How the bench stands.

    Attributes:
        name: of the bench.
        turntable: what the board says of itself; empty where it is not connected.
        angle_deg: where the table stands, as far as is known.
        lasers_on: names of the lasers that were switched on and not off.
        camera: state of the camera.
        holder: the job that holds the bench; empty for none.
        problems: what is wrong now, as sentences.
    """

    name: str
    turntable: str
    angle_deg: float
    lasers_on: tuple[str, ...]
    camera: CameraState
    holder: str
    problems: tuple[str, ...]


class Bench:
    """A camera, a turntable with its lasers, and who may use them.

    Devices are connected one by one: what is missing does not keep the other from working. Everything may be
    called from any thread; what moves or lights wants the lease of the bench first.

    Attributes:
        description: the bench file.
        turntable: the board.
        camera: the camera.
        lasers: entries of the bench file by name.
        world: the simulated world, where a device is simulated.
        stops: how often everything was made safe.
        zero_name: names the zero of the table's angles; another one each time that it is set anew.
        ask: tells a person what to do, and returns when it is done, for tables that are turned by hand; None
            where there is nobody. The devices of another bench ask the same.
    """

    def __init__(
        self,
        description: BenchDescription,
        turntable: Turntable,
        camera: Camera,
        *,
        world: SimulatedWorld | None = None,
        folder: "tempfile.TemporaryDirectory[str] | None" = None,
        lit: dict[str, None] | None = None,
    ) -> None:
        self.description, self.turntable, self.camera, self.world = description, turntable, camera, world
        self.lasers: Mapping[str, LaserEntry] = {laser.name: laser for laser in description.lasers}
        self._folder = folder
        self._watchdog = Watchdog()
        self._lock = threading.Lock()
        self._connecting, self._meeting = threading.RLock(), threading.RLock()
        self._stopping, self._stopped = 0, threading.Condition()
        self._lease = threading.Semaphore()
        self._holder = ""
        self._lit: dict[str, None] = {} if lit is None else lit
        self._lit_at_s: dict[str, float] = {}
        self._burned_s: defaultdict[str, float] = defaultdict(float)
        self._problems: dict[str, str] = {}
        self.stops = 0
        self.zero_name = uuid4().hex
        self._is_halted = False
        self._is_guarded = self._is_let_go = False
        self._where: PositionUnknown | None = None
        self.ask: Callable[[str], None] | None = None

    @classmethod
    def build(cls, description: BenchDescription, *, ask: Callable[[str], None] | None = None) -> Self:
        """The devices that a bench file names, not connected yet.

        Args:
            description: of the bench.
            ask: see `Bench`.

        Raises:
            OptionError, BenchFileError: a driver or an option does not exist.
        """
        folder, world = None, None
        lit: dict[str, None] = {}
        if description.is_simulated:
            plan = world_plan(description)
            folder = tempfile.TemporaryDirectory(prefix="turnscan-", ignore_cleanup_errors=True)
        try:
            if folder is not None:
                world = SimulatedWorld(plan, Path(folder.name))
            table: Turntable = _made(TURNTABLES, description.turntable, world, ask)
            # A camera that plays back a recording shows what fits the table and the lasers.
            driver = _made(CAMERAS, description.camera, world, lambda: (table.angle_deg, tuple(lit)))
        except BaseException:
            if world is not None:
                world.close()
            if folder is not None:
                folder.cleanup()
            raise
        camera = _camera(driver, description.camera)
        bench = cls(description, table, camera, world=world, folder=folder, lit=lit)
        bench.ask = ask
        return bench

    def connect(self) -> None:
        """Connect whatever is not connected; tries both before it complains about one.

        Raises:
            PositionUnknown: the board is there, but where the table stands has to be told (`turntable.zero`).
            DeviceError: the first thing that failed.
        """
        errors: list[DeviceError] = []
        with self._connecting:
            for name, connect in (("turntable", self.connect_turntable), ("camera", self.connect_camera)):
                try:
                    connect()
                except DeviceError as error:
                    self._problems[name] = error.message
                    errors.append(error)
        if errors:
            raise min(errors, key=lambda error: isinstance(error, PositionUnknown))

    def connect_turntable(self) -> None:
        """Connect the board; all lasers are off afterwards. An emergency stop meanwhile has it begin again.

        Raises:
            PositionUnknown: until `zero` says where the table stands.
            DeviceError: as `Turntable.connect`.
        """
        with self._meeting:
            self._note_dark(*self.lasers_on)
            stops, self._is_let_go = self.stops, False
            try:
                self._meet_board()
            except DeviceError:
                if self.stops == stops or self._is_let_go:
                    raise
                # Whoever stops the board takes the word from who connects it.
                with self._stopped:
                    self._stopped.wait_for(lambda: not self._stopping, _LONGEST_STOP_S)
                self._meet_board()
        self._problems.pop("turntable", None)
        if self._where is not None:
            raise self._where

    def _meet_board(self) -> None:
        if not self.turntable.is_connected:
            self._is_guarded = False
        try:
            self.turntable.connect()
        except PositionUnknown as error:
            self._where = error
        finally:
            if self.turntable.is_connected:
                self._watchdog.guard(self.turntable.farewell)
                self._is_guarded = True

    def connect_camera(self) -> None:
        """Connect the camera.

        Raises:
            DeviceError: as `Camera.connect`; or it is away, and its own thread has not got it back yet.
        """
        self.camera.connect()
        state = self.camera.state
        if not state.is_connected:
            raise DeviceLost(self.camera.name, state.last_error or "has gone")
        self._problems.pop("camera", None)

    def disconnect(self) -> None:
        """Make everything safe and let go of it. Never fails."""
        self._is_let_go = True
        with contextlib.suppress(DeviceError):
            self.make_safe()
        self.turntable.disconnect()
        self.camera.disconnect()
        self._watchdog.close()
        if self.world is not None:
            self.world.close()
        if self._folder is not None:
            self._folder.cleanup()

    def exchange(self, description: BenchDescription) -> None:
        """Other devices in place of these, not connected yet; whoever has this bench has the new ones.

        Raises:
            BenchBusy: a job holds the bench.
            OptionError, BenchFileError: the new one cannot be built; all is as it was.
        """
        with self.lease("choosing another bench", wait_s=0.0), self._connecting:
            fresh = type(self).build(description, ask=self.ask)
            former = Bench(
                self.description, self.turntable, self.camera, world=self.world, folder=self._folder
            )
            former._watchdog = self._watchdog
            former.disconnect()
            with self._lock:
                self.description, self.lasers = fresh.description, fresh.lasers
                self.turntable, self.camera, self.world = fresh.turntable, fresh.camera, fresh.world
                self._folder, self._watchdog, self._lit = fresh._folder, fresh._watchdog, fresh._lit
                self._is_guarded = False
                self._lit_at_s.clear()
                for device in ("turntable", "camera"):
                    self._problems.pop(device, None)
                self._where = None

    @contextmanager
    def lease(self, holder: str, *, wait_s: float = _LEASE_WAIT_S) -> Iterator[None]:
        """Hold the bench for a job; lasers that somebody left on go off, and all is safe on every way out.

        Raises:
            BenchBusy: another job holds it.
            DeviceError: a laser that is on cannot be put out.
        """
        if not self._lease.acquire(timeout=wait_s):
            raise BenchBusy(f"The bench is in use: {self._holder}.")
        self._holder, self._is_halted = holder, False
        try:
            with self._lock:
                left_on = tuple(self._lit)
            self._put_out(left_on)
            yield
        finally:
            try:
                with contextlib.suppress(DeviceError):
                    self.make_safe()
            finally:
                self._holder, self._is_halted = "", False
                self._lease.release()

    def refuse_held(self, wanted: str) -> None:
        """Complain where a job holds the bench.

        Raises:
            BenchBusy: naming the job, and what was wanted.
        """
        if self._holder:
            raise BenchBusy(f"The bench is in use ({self._holder}), so there is no {wanted}.")

    @contextmanager
    def lit(self, *names: str) -> Iterator[None]:
        """These lasers are on inside the block, and off after it."""
        try:
            for name in names:
                self.switch(name, True)
            yield
        except BaseException:
            # What went wrong first is what a person should be told.
            with contextlib.suppress(DeviceError):
                self._put_out(names)
            raise
        self._put_out(names)

    def switch(self, name: str, is_on: bool) -> None:
        """Put one laser on or off.

        Raises:
            OptionError: there is no such laser.
            DeviceError: the board does not do it.
        """
        if name not in self.lasers:
            known = ", ".join(self.lasers) or "none"
            raise OptionError(f"The bench has no laser called {name!r}.", f"It has: {known}.")
        if is_on and self._is_halted:
            raise MoveStopped(self.description.turntable.driver, "the emergency stop was pressed")
        if is_on and not self._is_guarded:
            # Nobody could put it out again if this program died now.
            raise DeviceLost(
                self.description.turntable.driver, "is not connected yet", "Connect it, or wait until it is."
            )
        if is_on:
            # Noted before it is done, so that nobody who asks in between is told that it is dark.
            with self._lock:
                self._lit[name] = None
                self._lit_at_s.setdefault(name, time.monotonic())
        self.turntable.set_laser(self.lasers[name].channel, is_on)
        if not is_on:
            self._note_dark(name)

    def _put_out(self, names: Sequence[str]) -> None:
        """Every one of them, even where the board complains about another."""
        with contextlib.ExitStack() as stack:
            for name in names:
                stack.callback(self.switch, name, False)

    def _note_dark(self, *names: str) -> None:
        with self._lock:
            for name in names:
                self._lit.pop(name, None)
                now_s = time.monotonic()
                self._burned_s[name] += now_s - self._lit_at_s.pop(name, now_s)

    @property
    def burned_s(self) -> Mapping[str, float]:
        """How long each laser has been on since the bench was built, seconds."""
        with self._lock:
            now_s = time.monotonic()
            return {
                name: self._burned_s[name] + now_s - self._lit_at_s.get(name, now_s) for name in self.lasers
            }

    @property
    def is_placed(self) -> bool:
        """Whether it is known where the table stands."""
        return self._where is None

    def lose_place(self, error: PositionUnknown) -> None:
        """Nobody knows where the table stands, until `zero` tells; connecting says so until then."""
        self._where = error

    def zero(self, angle_deg: float) -> None:
        """The place where the table stands is called by this angle from now on."""
        self.turntable.zero(angle_deg)
        self._where = None
        self.zero_name = uuid4().hex

    def make_safe(self) -> None:
        """Table stopped, lasers off, motor let go; from any thread, in any state.

        Raises:
            DeviceError: the board cannot be reached.
        """
        self.stops += 1
        try:
            self._stop_board()
        except DeviceError:
            # Whoever was connecting it has let go of the port, to begin again.
            if self._is_guarded or not self._meeting.acquire(timeout=_LONGEST_STOP_S):
                raise
            try:
                if not self.turntable.is_connected:
                    raise
                self._stop_board()
            finally:
                self._meeting.release()
        finally:
            self._note_dark(*self.lasers_on)

    def _stop_board(self) -> None:
        with self._stopped:
            self._stopping += 1
        try:
            if self.turntable.is_connected:
                self.turntable.make_safe()
        finally:
            with self._stopped:
                self._stopping -= 1
                self._stopped.notify_all()

    def halt(self) -> None:
        """Emergency stop: make safe, and whoever holds the bench lights nothing any more.

        Raises:
            DeviceError: the board cannot be reached.
        """
        self._is_halted = bool(self._holder)
        self.make_safe()

    def recover(self, timeout_s: float, on_wait: Callable[[str], None] | None = None) -> None:
        """Bring back what was lost: wait for the devices, under whatever name, and connect them.

        Args:
            timeout_s: give up after so long.
            on_wait: told, once for each, what is being waited for.

        Raises:
            PositionUnknown: all is back, but the table's angle has to be told.
            DeviceError: what was wrong at the last try.
        """
        ends, told, pause_s = time.monotonic() + timeout_s, "", 0.1
        while True:
            try:
                self.connect()
            except PositionUnknown:
                raise
            except DeviceError as error:
                if error.message != told and on_wait is not None:
                    on_wait(error.message)
                told = error.message
                if time.monotonic() + pause_s > ends:
                    raise
                time.sleep(pause_s)
                pause_s = min(1.0, 1.5 * pause_s)
            else:
                return

    def restore(self, angle_deg: float) -> None:
        """A simulated world begins with its table at 0; let it stand where an earlier one left it."""
        if self.world is not None:
            way = 1.0 if self.description.turntable.direction == "ccw" else -1.0
            plant, now_s = self.world.plant, self.world.clock.now_s()
            plant.slip(way * angle_deg - plant.at(now_s).angle_deg, now_s)

    @property
    def lasers_on(self) -> tuple[str, ...]:
        """Names of the lasers that were switched on and not off."""
        with self._lock:
            return tuple(self._lit)

    @property
    def holder(self) -> str:
        """The job that holds the bench; empty for none."""
        return self._holder

    def complain(self, about: str, problem: str) -> None:
        """Tell among the problems of something beside the devices that will stay as it is."""
        self._problems[about] = problem

    def snapshot(self) -> BenchSnapshot:
        """How it stands now; never waits for a device."""
        lit = self.lasers_on
        is_there = self._is_guarded and self.turntable.is_connected
        return BenchSnapshot(
            self.description.name,
            self.turntable.facts.firmware if is_there else "",
            self.turntable.angle_deg,
            lit,
            self.camera.state,
            self._holder,
            tuple(self._problems.values()),
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.disconnect()


def world_plan(description: BenchDescription) -> WorldPlan:
    """The `[simulation]` table of a bench file, with the bench's own platter and board.

    Raises:
        BenchFileError: a key or value that means nothing.
    """
    options: Json = dict(description.simulation or {})
    known = {field.name for field in fields(WorldPlan)}
    for key in options:
        if key not in known:
            raise BenchFileError(
                "simulation", f"there is no option {key!r}", f"Known are: {', '.join(sorted(known))}."
            )
    if description.platter is not None:
        options["platter"] = description.platter.spec()
    if description.board is not None:
        options["board"] = description.board.spec()
    try:
        return WorldPlan(**options)
    except (TypeError, ValueError) as error:
        raise BenchFileError("simulation", str(error)) from error


def _camera(driver: Any, entry: CameraEntry) -> Camera:
    settings = {
        use: CameraSettings(controls.values)
        for use, controls in (
            (Use.LASER, entry.laser),
            (Use.TEXTURE, entry.texture),
            (Use.BOARD, entry.board),
        )
    }
    return Camera(
        driver,
        rotation=entry.rotation,
        is_mirrored=entry.mirror,
        latency_s=1e-3 * entry.latency_ms,
        settings=settings,
    )


def _made(registry: Registry[Any], entry: DriverEntry, world: SimulatedWorld | None, ask: Any) -> Any:
    """A device by name; an option that its driver does not take is named."""
    maker = registry.maker(entry.driver)
    taken = inspect.signature(maker).parameters
    injected = {name: value for name, value in (("world", world), ("ask", ask)) if name in taken}
    for key in entry.options:
        if key not in taken or key in injected:
            known = ", ".join(name for name in taken if name not in injected) or "none"
            raise OptionError(
                f"The {registry.kind} {entry.driver!r} has no option {key!r}.", f"It takes: {known}."
            )
    try:
        return maker(**entry.options, **injected)
    except TypeError as error:
        raise OptionError(f"The {registry.kind} {entry.driver!r} cannot be built: {error}.") from error
