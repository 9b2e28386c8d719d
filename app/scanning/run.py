"""A scan from beginning to end: what to do when a device goes away, and when somebody stops it."""

from collections.abc import Callable, Generator
from contextlib import closing
from dataclasses import dataclass
from typing import Protocol

from app.devices.bench import Bench
from app.errors import DeviceError, DeviceRefused, MoveStopped, PositionUnknown
from app.recording.manifest import FrameEntry
from app.recording.reader import Recording
from app.scanning.plan import Look
from app.scanning.scan import Taken, scan_steadily, scan_steps
from app.scanning.session import ScanSession

# Devices that fail so often without a single picture in between are not worth another try.
_TRIES_WITHOUT_A_PICTURE = 6


class Watch(Protocol):
    """Who is told how a scan goes; called in the thread of the scan."""

    def taken(self, taken: Taken, entry: FrameEntry) -> None:
        """A picture is on disk. TurnBrokenOff, raised here, rests the scan until `waiting` returns."""
        ...

    def waiting(self, problem: str) -> None:
        """A device is away; the scan goes on when it is back."""
        ...

    def going_on(self) -> None:
        """It is back."""
        ...


FindAngle = Callable[[Bench, float, float], float | None]
"""Where the table stands, found by looking, between two angles in degrees; None where nothing shows it."""


def first_of(*finders: FindAngle) -> FindAngle:
    """Asks one after the other, until one knows."""

    def find(bench: Bench, low_deg: float, high_deg: float) -> float | None:
        found = (finder(bench, low_deg, high_deg) for finder in finders)
        return next((angle for angle in found if angle is not None), None)

    return find


@dataclass(frozen=True, slots=True)
class Recovery:
    """What a scan does about trouble.

    Attributes:
        patience_s: how long it waits for a device to come back.
        find_angle: looks where the table stands, after its board was lost in mid-move.
    """

    patience_s: float = 60.0
    find_angle: FindAngle | None = None


def run_scan(bench: Bench, session: ScanSession, watch: Watch, recovery: Recovery | None = None) -> Recording:
    """Take everything that the session lacks.

    Whatever happens, the bench is made safe and what was taken stays; the session is then paused and can be
    resumed, in this program or another.

    Args:
        bench: connected; leased here.
        session: new or resumed; `place_table` comes before a resumed one.
        watch: see there.
        recovery: see there.

    Raises:
        DeviceError: a device failed and did not come back.
        OutputError: the disk is full.
    """
    recovery = recovery or Recovery()
    session.zero = bench.zero_name
    try:
        with bench.lease("a scan"):
            try:
                _take_all(bench, session, watch, recovery)
            finally:
                _make_safe(bench, session)
        return session.finish()
    except BaseException as error:
        session.pause(str(error) or "it was stopped")
        raise


def place_table(
    bench: Bench, session: ScanSession, recovery: Recovery, *, takes_target: bool = False
) -> None:
    """Tell a freshly connected board where the table stands, as the resumed session knows it.

    Args:
        bench: connected; leased by nobody.
        session: resumed.
        recovery: its `find_angle` looks, where the table was moving when the program ended.
        takes_target: where nobody can look, take it that the move was completed.

    Raises:
        PositionUnknown: the table was moving, and nothing shows where it is.
    """
    table = session.table
    if bench.turntable.facts.turns_by_itself and session.shots:
        raise PositionUnknown(bench.description.turntable.driver, 0.0, 360.0)
    with bench.lease("a scan"):
        if table.moving_to_deg is None or table.moving_to_deg == table.angle_deg:
            bench.zero(table.angle_deg)
            return
        low, high = sorted((table.angle_deg, table.moving_to_deg))
        found = _looked(bench, recovery, low, high)
        if found is None and not takes_target:
            raise PositionUnknown(bench.description.turntable.driver, low, high)
        at_deg = table.moving_to_deg if found is None else found
        bench.zero(at_deg)
        session.standing(at_deg)


def _take_all(bench: Bench, session: ScanSession, watch: Watch, recovery: Recovery) -> None:
    failures, shots_before = 0, session.shots
    while True:
        try:
            # However it ends, the lasers are off before anything else is done.
            with closing(_shots(bench, session)) as shots:
                for taken in shots:
                    watch.taken(taken, session.record(taken))
            return
        except (MoveStopped, DeviceRefused):
            raise
        except DeviceError as error:
            if isinstance(error, PositionUnknown):
                bench.lose_place(error)
            failures = failures + 1 if session.shots == shots_before else 1
            shots_before = session.shots
            if failures > _TRIES_WITHOUT_A_PICTURE:
                raise
            watch.waiting(error.message)
            _recover(bench, session, watch, recovery)
            watch.going_on()


def _shots(bench: Bench, session: ScanSession) -> Generator[Taken, None, None]:
    if session.plan.mode == "step":
        yield from scan_steps(bench, session.plan, session.is_taken, session.moving)
        return
    under_way: Look | None = None
    for taken in scan_steadily(bench, session.plan, session.reached_deg, session.moving):
        if under_way is not None and taken.look != under_way:
            session.end_turn(under_way)
        under_way = taken.look
        yield taken
    if under_way is not None:
        session.end_turn(under_way)


def _recover(bench: Bench, session: ScanSession, watch: Watch, recovery: Recovery) -> None:
    """Devices back, table where the board believes it is, or an error."""
    try:
        if bench.turntable.is_connected:
            bench.make_safe()
    except DeviceError:
        # It is asked again below, by connecting anew.
        pass
    try:
        bench.recover(recovery.patience_s, watch.waiting)
    except PositionUnknown as error:
        found = _looked(bench, recovery, error.lowest_deg, error.highest_deg)
        if found is None:
            raise
        bench.zero(found)
        session.zero = bench.zero_name
    session.standing(bench.turntable.angle_deg)


def _looked(bench: Bench, recovery: Recovery, low_deg: float, high_deg: float) -> float | None:
    return None if recovery.find_angle is None else recovery.find_angle(bench, low_deg, high_deg)


def _make_safe(bench: Bench, session: ScanSession) -> None:
    """Lasers off, table stopped; note where it stands while that is known."""
    try:
        bench.make_safe()
    except DeviceError:
        return
    if bench.turntable.is_connected and bench.is_placed:
        session.standing(bench.turntable.angle_deg)
