"""The calibrations of this run of the server, by the job that makes each."""

import threading
from collections import OrderedDict

from app.errors import NotThere
from app.jobs.calibrate_run import CalibrationRun

_KEPT = 20


class CalibrationDesk:
    """Where a page asks how a calibration goes. Safe from several threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._runs: OrderedDict[str, CalibrationRun] = OrderedDict()

    def add(self, job_id: str, run: CalibrationRun) -> None:
        with self._lock:
            self._runs[job_id] = run
            while len(self._runs) > _KEPT:
                self._runs.popitem(last=False)

    def find(self, job_id: str) -> CalibrationRun:
        """Raises NotThere."""
        with self._lock:
            run = self._runs.get(job_id)
        if run is None:
            raise NotThere(f"There is no calibration {job_id!r}.", "Begin one, or go on with a session.")
        return run

    @property
    def latest(self) -> CalibrationRun | None:
        """The one that was begun last."""
        with self._lock:
            return next(reversed(self._runs.values()), None)
