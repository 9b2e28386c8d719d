"""What `log.txt` in the folder of a scan is told while the scan is taken."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from app.calibration.record import CalibrationRecord
from app.errors import OutputError, ScannerError
from app.jobs.job import JobCancelled
from app.library.log import write_line
from app.scanning.plan import ScanPlan
from app.scanning.session import ScanSession


class ScanLog:
    """Notes how a scan goes. A disk that is full costs the line, not the scan."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def note(self, words: str) -> None:
        with suppress(OutputError):
            write_line(self.folder, words)

    @contextmanager
    def following(
        self, session: ScanSession, record: CalibrationRecord | None, bench_name: str
    ) -> Iterator[None]:
        """Tell the beginning of the block, and its end where that comes too early."""
        begun = f"gone on with, after {session.shots} pictures" if session.shots else "begun"
        made = "none" if record is None else f"{Path(record.source).name}, of {record.created:%Y-%m-%d %H:%M}"
        self.note(f"Scan {begun}: {_in_words(session.plan)}. Bench: {bench_name}. Calibration: {made}.")
        try:
            yield
        except BaseException as error:
            reason = error.message if isinstance(error, ScannerError) else repr(error)
            reason = "it was cancelled" if isinstance(error, JobCancelled) else reason.rstrip(".")
            self.note(f"Ended early with {session.shots} pictures: {reason}.")
            raise


def _in_words(plan: ScanPlan) -> str:
    lasers = " and ".join(plan.lasers) + (" in one picture" if plan.together else "")
    if plan.mode == "continuous":
        return f"{plan.turn_deg:g} degrees at {plan.seconds_per_turn:g} s per turn, lasers {lasers}"
    exposures = ", ".join(f"{each:g}" for each in plan.exposures_us)
    stack = f", exposures of {exposures} us" if exposures else ""
    return f"{plan.steps} stops in {plan.turn_deg:g} degrees, {plan.shots} pictures, lasers {lasers}{stack}"
