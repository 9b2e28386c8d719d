"""What the routes work with, made once by the server."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, cast

from fastapi import Depends
from starlette.requests import HTTPConnection

from app.access.access import Access
from app.api.about import About
from app.api.bench_choice import BenchChoice
from app.api.emergency import EmergencyStop
from app.api.scene import Scene
from app.calibration.record import CalibrationRecord
from app.calibration.store import CalibrationStore
from app.devices.bench import Bench
from app.errors import CalibrationFileError
from app.jobs.calibrate_boards import ShowBoards
from app.jobs.calibrate_desk import CalibrationDesk
from app.jobs.runner import JobRunner
from app.library.library import Library
from app.live.pictures import LivePictures
from app.scanning.profile import Profile

if TYPE_CHECKING:
    # It shows jobs as their routes do, and these are given the services.
    from app.api.news import NewsDesk


@dataclass(frozen=True, slots=True)
class Services:
    """Everything that outlives a request.

    Attributes:
        about: the server itself.
        choice: which bench it is.
        on_scan: told when a scan begins, so that the 3D view makes room.
        on_scan_end: told when it has ended, however.
        calibrating: where to ask how a calibration goes.
        on_calibrated: told a calibration that is in use from now on.
        on_boards: told where the board was in the views of a calibration.
        on_profile: told each profile of a scan as it is computed.
    """

    about: About
    choice: BenchChoice
    bench: Bench
    runner: JobRunner
    library: Library
    calibrations: CalibrationStore
    live: LivePictures
    scene: Scene
    access: Access
    emergency: EmergencyStop
    desk: "NewsDesk"
    calibrating: CalibrationDesk
    on_scan: Callable[[], None]
    on_profile: Callable[[Profile], None]
    on_calibrated: Callable[[CalibrationRecord], None]
    on_boards: ShowBoards
    on_scan_end: Callable[[], None]

    @property
    def bench_spec(self) -> str:
        """What names the bench: a file, or `simulated`."""
        return self.choice.spec

    def calibration(self) -> CalibrationRecord | None:
        """The one in use; on a simulated bench that has none yet, what a perfect one would find."""
        world = self.bench.world
        try:
            record: CalibrationRecord | None = self.calibrations.current()
        except CalibrationFileError:
            record = None
        is_whole = record is not None and record.lasers and record.axis is not None
        if world is None or is_whole:
            return record
        rig = world.rig
        return CalibrationRecord(
            camera=rig.camera, lasers=rig.lasers, axis=rig.axis, method="simulated",
            source="the simulated bench",
        )  # fmt: skip


async def _services(connection: HTTPConnection) -> Services:
    return cast(Services, connection.app.state.services)


Served = Annotated[Services, Depends(_services)]
