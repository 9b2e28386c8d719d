"""A scan on disk: its recording, and beside it what it needs to go on after any end."""

import json
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field

from app.devices.bench import Bench
from app.documents import Entry, Json, compose, read_document
from app.errors import OptionError, RecordingError
from app.files import write_whole
from app.recording.manifest import FrameEntry, Header
from app.recording.reader import Recording
from app.recording.writer import RecordingWriter
from app.scanning.plan import Look, ScanPlan
from app.scanning.scan import Taken

SCAN_FILE = "scan.json"
Status = Literal["running", "paused", "finished"]
Degrees = Annotated[float, Field(ge=-1e6, le=1e6)]


class TableState(Entry):
    """Where the table is, or between what.

    Attributes:
        angle_deg: where it stood last.
        moving_to_deg: where it was going; absent while it stands.
    """

    angle_deg: Degrees = 0.0
    moving_to_deg: Degrees | None = None


class ScanFile(Entry):
    """`scan.json`."""

    format: Literal["turnscan-scan"]
    version: Literal[1]
    bench: str
    plan: ScanPlan
    status: Status
    table: TableState
    reason: str = ""
    zero: str = ""


class ScanSession:
    """One scan as it grows.

    Attributes:
        folder: of the recording.
        plan: what it is to do.
        bench_spec: what names its bench: a file, or `simulated`.
        status: running, paused or finished.
        table: where the table is.
        zero: names what its angles are counted from, see `Bench.zero_name`; empty where nobody knows.
    """

    def __init__(self, folder: Path, plan: ScanPlan, bench_spec: str, writer: RecordingWriter) -> None:
        self.folder, self.plan, self.bench_spec, self.writer = folder, plan, bench_spec, writer
        self.status: Status = "running"
        self.table = TableState()
        self.reason = self.zero = ""
        self._taken: set[tuple[int, str]] = set()
        self._reached_deg: dict[str, float] = {}
        self._began_s: float | None = None
        for entry in writer.entries:
            self._note(entry)

    @classmethod
    def create(cls, folder: Path, plan: ScanPlan, bench: Bench, bench_spec: str) -> Self:
        """Start a scan in a new or empty folder.

        Args:
            folder: of the recording.
            plan: what it is to do.
            bench: with its camera connected.
            bench_spec: what names the bench, for whoever goes on with the scan.

        Raises:
            OutputError: the folder holds something, or cannot be made.
            OptionError: a simulated bench at another than true speed is to be scanned continuously.
        """
        _refuse_hurried(bench, plan)
        session = cls(folder, plan, bench_spec, RecordingWriter.create(folder, _header(bench, plan)))
        session.save()
        return session

    @classmethod
    def resume(cls, folder: Path) -> Self:
        """Go on with a scan that ended early.

        Raises:
            RecordingError: the folder holds no scan, or one that cannot be read.
        """
        saved = read_document(folder / SCAN_FILE, ScanFile, _not_a_scan)
        if saved.status == "finished":
            raise RecordingError(
                str(folder), "is finished", "Reconstruct it, or name another folder for a new scan."
            )
        session = cls(folder, saved.plan, saved.bench, RecordingWriter.resume(folder))
        session.table, session.reason, session.zero = saved.table, saved.reason, saved.zero
        session._trust_last_picture()
        return session

    @property
    def shots(self) -> int:
        """How many pictures there are."""
        return len(self.writer.entries)

    @property
    def done(self) -> float:
        """How much of the plan is done, 0..1."""
        if self.plan.mode == "step":
            return min(1.0, self.shots / self.plan.shots)
        turned = sum(
            min(self._reached_deg.get(look.key, 0.0), self.plan.turn_deg) for look in self.plan.passes
        )
        return turned / (self.plan.turn_deg * len(self.plan.passes))

    def is_taken(self, stop: int, look: Look) -> bool:
        return (stop, look.key) in self._taken

    def reached_deg(self, look: Look) -> float | None:
        """Angle of the last picture within a turn of a continuous scan; the whole turn once it is through."""
        return self._reached_deg.get(look.key)

    def end_turn(self, look: Look) -> None:
        """A turn of a continuous scan is through."""
        self._reached_deg[look.key] = self.plan.turn_deg

    def record(self, taken: Taken) -> FrameEntry:
        """Put a picture on disk. Raises as `RecordingWriter.append_encoded`."""
        if self._began_s is None:
            self._began_s = taken.time_s - self._last_time_s()
        entry = self.writer.append_encoded(
            taken.data,
            taken.look.role,
            taken.look.lasers,
            taken.angle_deg,
            time_s=max(0.0, taken.time_s - self._began_s),
            exposure_us=taken.exposure_us,
            extra={"stop": taken.stop, "look": taken.look.key},
        )
        self._note(entry)
        if self.plan.mode == "step" and self.table.moving_to_deg is not None:
            self.table = TableState(angle_deg=taken.angle_deg)
        return entry

    def moving(self, to_deg: float) -> None:
        """The table is about to move."""
        self.table = TableState(angle_deg=self.table.angle_deg, moving_to_deg=to_deg)
        self.save()

    def standing(self, at_deg: float) -> None:
        """The table stands, and where is known."""
        self.table = TableState(angle_deg=at_deg)

    def save(self) -> None:
        """Write `scan.json`. Raises OutputError."""
        document: Json = {
            "format": "turnscan-scan",
            "version": 1,
            "bench": self.bench_spec,
            "status": self.status,
            "reason": self.reason,
            "plan": self.plan.as_json(),
            "table": self.table.as_json(),
            "zero": self.zero,
        }
        checked = compose(ScanFile, document, SCAN_FILE, RecordingError)
        text = json.dumps(checked.as_json(), indent=1, allow_nan=False)
        write_whole(self.folder / SCAN_FILE, text.encode() + b"\n", is_durable=False)

    def pause(self, reason: str) -> None:
        """Let go of the files, for now; the scan can be resumed."""
        self.status, self.reason = "paused", reason
        self.writer.suspend()
        self.save()

    def finish(self) -> Recording:
        """Everything is taken. Raises OutputError."""
        recording = self.writer.close()
        self.status, self.reason = "finished", ""
        self.save()
        return recording

    def _last_time_s(self) -> float:
        """Resumed scans go on a second after their last picture."""
        times = [entry.time_s for entry in self.writer.entries if entry.time_s is not None]
        return max(times) + 1.0 if times else 0.0

    def _trust_last_picture(self) -> None:
        """A program that was killed could not say so, but a picture of a stop shows that it was reached."""
        going_to = self.table.moving_to_deg
        if self.plan.mode != "step" or going_to is None or not self.writer.entries:
            return
        stop, at_deg = self.writer.entries[-1].unknown.get("stop"), self.writer.entries[-1].angle_deg
        is_there = isinstance(stop, int) and self.plan.angle_deg(stop) == going_to
        if is_there and at_deg is not None:
            self.table = TableState(angle_deg=at_deg)

    def _note(self, entry: FrameEntry) -> None:
        stop, look = entry.unknown.get("stop"), entry.unknown.get("look")
        if not isinstance(stop, int) or not isinstance(look, str):
            return
        self._taken.add((stop, look))
        if self.plan.mode == "continuous" and entry.angle_deg is not None:
            number = next((n for n, each in enumerate(self.plan.passes) if each.key == look), 0)
            self._reached_deg[look] = entry.angle_deg - number * self.plan.turn_deg


def read_plan(folder: Path) -> ScanPlan:
    """What the scan in a folder is to do. Raises RecordingError."""
    return read_document(folder / SCAN_FILE, ScanFile, _not_a_scan).plan


def _header(bench: Bench, plan: ScanPlan) -> Header:
    description = bench.description
    return Header.of(
        bench.camera.facts.size,
        {laser.name: laser.colour for laser in description.lasers},
        direction=description.turntable.direction,
        seconds_per_turn=plan.seconds_per_turn if plan.mode == "continuous" else None,
        platter=None if description.platter is None else description.platter.spec(),
        camera_name=bench.camera.facts.name,
        extra={"bench": description.name},
    )


def _refuse_hurried(bench: Bench, plan: ScanPlan) -> None:
    """Angles by time are as wrong as time is."""
    rate = 1.0 if bench.world is None else bench.world.clock.rate
    if plan.mode == "continuous" and rate != 1.0:
        raise OptionError(
            f"The simulated bench runs at {rate:g} times true speed, where angles by time are wrong.",
            "Scan in steps, or give the bench rate = 1.",
        )


def _not_a_scan(where: str, problem: str) -> RecordingError:
    return RecordingError(where, problem, "Name the folder of a scan that was begun with `turnscan scan`.")
