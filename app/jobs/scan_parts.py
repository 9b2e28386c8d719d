"""What a scan is put together from, whoever starts it."""

import math
from collections.abc import Callable
from dataclasses import replace

from app.calibration.record import CalibrationRecord
from app.devices.bench import Bench
from app.errors import OptionError, ScannerError
from app.geometry.rig import Rig
from app.library.again import DETECTOR
from app.library.library import Library
from app.scanning.find_angle import MarkerFinder
from app.scanning.find_by_picture import PictureFinder
from app.scanning.live import LivePoints
from app.scanning.profile import Profile
from app.scanning.reconstruct import ReconstructionOptions
from app.scanning.run import Recovery, first_of
from app.scanning.session import ScanSession
from app.scanning.sources import scan_detector


def rig_of(record: CalibrationRecord | None) -> Rig | None:
    """The calibrated scanner; None where there is no calibration, or one of the camera alone."""
    return None if record is None or record.axis is None or not record.lasers else record.rig


def unfinished_in(library: Library) -> Callable[[str], bool]:
    """Tells of scans by name whether they can be gone on with."""

    def is_unfinished(name: str) -> bool:
        try:
            return library.scan(name).status == "paused"
        except ScannerError:
            return False

    return is_unfinished


def check_lasers(bench: Bench, names: tuple[str, ...], record: CalibrationRecord | None) -> None:
    """Whether bench and calibration know these lasers.

    Raises:
        OptionError: naming the laser, and those there are.
    """
    if not names:
        raise OptionError("The bench has no laser.", "List its lasers in the bench file.")
    for name in names:
        if name not in bench.lasers:
            known = ", ".join(bench.lasers) or "none"
            raise OptionError(f"The bench has no laser called {name!r}.", f"It has: {known}.")
        if record is not None and record.lasers and name not in record.lasers:
            known = ", ".join(record.lasers)
            raise OptionError(
                f"The calibration ({record.source}) knows no laser called {name!r}.",
                f"It knows: {known}. Name its lasers as the bench does, or calibrate again.",
            )


def recovery_for(
    session: ScanSession, record: CalibrationRecord | None, bench: Bench, patience_s: float
) -> Recovery:
    """Waits for devices; finds a lost place by the markers on the table, else by the pictures."""
    rig, platter = rig_of(record), bench.description.platter
    by_picture = PictureFinder(session.folder, is_of_stack=bool(session.plan.exposures_us))
    if rig is None or platter is None:
        return Recovery(patience_s, by_picture)
    return Recovery(patience_s, first_of(MarkerFinder(rig, platter.spec(), session.folder), by_picture))


def live_points_for(
    session: ScanSession,
    record: CalibrationRecord | None,
    bench: Bench,
    on_profile: Callable[[Profile], None] | None = None,
    detector: str = DETECTOR,
    options: ReconstructionOptions | None = None,
) -> LivePoints | None:
    """Computes points as pictures come; None without a calibration."""
    rig = rig_of(record)
    if rig is None:
        return None
    way = math.radians(1.0 if bench.description.turntable.direction == "ccw" else -1.0)
    has_partners = session.plan.mode == "step" and session.plan.with_dark
    options = options or ReconstructionOptions()
    return LivePoints(
        rig, scan_detector(detector, options.threshold),
        {name: entry.colour for name, entry in bench.lasers.items()},
        lambda angle_deg: way * angle_deg, on_profile=on_profile,
        is_grey=has_partners and bench.camera.facts.gives_jpeg,
        options=replace(options, is_prompt=True, with_colour=False),
        each_alone=session.plan.mode != "step",
    )  # fmt: skip
