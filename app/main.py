"""The server: everything it is made of, entered in order and left in reverse."""

import asyncio
import logging
import os
import threading
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import ExitStack, asynccontextmanager, closing
from importlib import import_module
from pathlib import Path

from fastapi import FastAPI
from starlette.requests import HTTPConnection

from app.access.access import Access
from app.allocator import share_arenas
from app.api.about import About
from app.api.bench_choice import BenchChoice
from app.api.document import api_application
from app.api.emergency import EmergencyStop
from app.api.guard import Guard, pass_of
from app.api.login_page import login_routes
from app.api.metrics import LoopLag, ScannerMetrics, metrics_route
from app.api.news import NewsDesk
from app.api.pages import page_routes
from app.api.scene import Scene
from app.api.services import Services
from app.api.traffic import Traffic, TrafficCounted
from app.calibration.record import CalibrationRecord
from app.calibration.store import CalibrationStore
from app.devices.bench import Bench
from app.devices.bench_file import BenchDescription
from app.devices.no_bench import no_bench
from app.errors import (
    BenchFileError,
    CalibrationFileError,
    DeviceError,
    OptionError,
    OutputError,
    ScannerError,
)
from app.files import make_folder
from app.follow import Follower
from app.jobs.calibrate_desk import CalibrationDesk
from app.jobs.events import BenchChanged, EventBus, Notice
from app.jobs.runner import JobRunner
from app.jobs.scan_parts import unfinished_in
from app.library.library import Library
from app.live.dead_man import DeadMan
from app.live.pictures import LivePictures
from app.settings import Settings
from app.viewer.cloud_view import CloudView
from app.viewer.proxy import view_routes

SETTING_UP = "setting up"
"""Name of the thread that connects devices and compiles for them; nobody waits for it."""
_FIRST_ANSWERS_S = 0.1
# Each takes a while to load, which neither the start shall wait for nor the first job.
_NEEDED_LATER = ("app.jobs.calibrate_solve", "app.surface.meshing.make")
_log = logging.getLogger(__name__)


def create_app(
    settings: Settings,
    description: BenchDescription | ScannerError,
    access: Access | None = None,
    hosts: Callable[[], Sequence[str]] = tuple,
) -> FastAPI:
    """The application; devices are connected when it starts, and what is missing is said by `/bench`.

    Args:
        settings: see there.
        description: of the bench, or why there is none.
        access: of the folder; opened here where nobody else needs it.
        hosts: names and addresses at which other machines reach the server.

    Raises:
        AccessFileError: it is not clear who may use the server.
    """
    access = access or Access.open(settings.folder)
    share_arenas()
    with ExitStack() as building:
        building.callback(access.save_seen)
        machine = building.enter_context(_bench(description, lambda words: runner.ask_person(words)))
        view = building.enter_context(CloudView())
        building.enter_context(Follower(machine, view))
        for folder in (settings.scans, settings.jobs):
            _make(folder, machine)
        bus = EventBus()
        library = Library(settings.scans, settings.upload_bytes)
        runner = JobRunner(settings.jobs, bus, is_unfinished=unfinished_in(library))
        building.callback(runner.close)
        pictures = building.enter_context(closing(LivePictures.of_bench(machine)))
        traffic, lag = Traffic(), LoopLag()
        building.enter_context(DeadMan(machine, lambda: traffic.seen_s, lambda names: _tell_dark(bus, names)))
        scene = Scene(view)
        served = Services(
            about=About(str(settings.folder.resolve()), settings.is_local, hosts),
            choice=BenchChoice(
                settings.bench_spec,
                settings.folder / "bench.toml",
                machine,
                pictures,
                lambda: _show_known(served, view),
            ),
            bench=machine,
            runner=runner,
            library=library,
            calibrations=CalibrationStore(settings.calibrations),
            live=pictures,
            scene=scene,
            access=access,
            emergency=EmergencyStop(machine, runner.cancel_on_bench, lambda: bus.publish(BenchChanged())),
            desk=NewsDesk(machine, runner, pictures, traffic, lambda: view.viewers),
            calibrating=CalibrationDesk(),
            on_calibrated=lambda record: _show_calibration(record, view, pictures),
            on_boards=view.show_boards,
            on_scan=lambda: scene.begin(tuple(machine.lasers)),
            on_profile=scene.add,
            on_scan_end=scene.finish,
        )
        parts = building.pop_all()

    @asynccontextmanager
    async def lifespan(application: FastAPI) -> AsyncIterator[None]:
        is_over = threading.Event()
        setting_up = threading.Thread(target=_set_up, args=(served, view, is_over), name=SETTING_UP)
        setting_up.daemon = True
        with parts:
            # What it imports would hold up the first answers.
            starting = asyncio.get_running_loop().call_later(_FIRST_ANSWERS_S, setting_up.start)
            measuring = asyncio.create_task(lag.run())
            yield
            is_over.set()
            starting.cancel()
            measuring.cancel()

    application = api_application(lifespan)
    application.state.services = served
    application.router.routes.extend(view_routes(view, _may_enter))
    metrics = ScannerMetrics(machine, runner, pictures, traffic, lag, lambda: view.viewers)
    application.router.routes.append(metrics_route(metrics))
    application.router.routes.extend(page_routes())
    application.add_middleware(TrafficCounted, traffic=traffic)
    application.router.routes.extend(login_routes())
    # Last, so that it comes before everything else.
    application.add_middleware(Guard, access=access)
    return application


def _bench(description: BenchDescription | ScannerError, ask: Callable[[str], None]) -> Bench:
    """That of a description; where it cannot be built, one without devices, which says why."""
    try:
        if not isinstance(description, ScannerError):
            return Bench.build(description, ask=ask)
        machine = no_bench(description)
    except (OptionError, BenchFileError) as error:
        machine = no_bench(error)
    machine.ask = ask
    return machine


def _make(folder: Path, machine: Bench) -> None:
    """A folder to keep things in; where there can be none, the bench says so and everything else works."""
    try:
        make_folder(folder)
        if not os.access(folder, os.W_OK | os.X_OK):
            raise OutputError(str(folder), "cannot be written")
    except OutputError as error:
        machine.complain(str(folder), f"{error.message}: nothing can be kept")
        _log.warning("%s. %s", error.message, error.hint)


def _may_enter(connection: HTTPConnection) -> bool:
    return pass_of(connection) is not None


def _tell_dark(bus: EventBus, names: tuple[str, ...]) -> None:
    lasers = " and ".join(names)
    bus.publish(
        Notice(f"Nobody was there for a while, so the lasers went off: {lasers}.", "Switch them on again.")
    )
    bus.publish(BenchChanged())


def _show_calibration(record: CalibrationRecord, view: CloudView, pictures: LivePictures) -> None:
    """In the 3D view and over the live pictures; one of the camera alone shows nothing there."""
    if record.lasers and record.axis is not None:
        view.show_rig(record.rig)
        pictures.learn(rig=record.rig)


def _set_up(served: Services, view: CloudView, is_over: threading.Event) -> None:
    """What takes time: devices, the scene that a calibration allows, and what only work needs."""
    try:
        served.bench.connect()
    except DeviceError as error:
        if not is_over.is_set():
            _log.warning("%s. %s", error.message.rstrip("."), error.hint)
    if not is_over.is_set():
        _show_known(served, view)
    for module in _NEEDED_LATER:
        if not is_over.is_set():
            import_module(module)


def _show_known(served: Services, view: CloudView) -> None:
    """Of a bench that is new, or has just been connected."""
    served.runner.bus.publish(BenchChanged())
    try:
        record = served.calibration()
    except CalibrationFileError as error:
        _log.warning("%s", error.message)
        return
    if record is not None:
        served.on_calibrated(record)
    if served.bench.world is not None:
        served.live.learn(board=served.bench.world.stage.board)
