"""Makes the simulated camera's pictures in another process, as a real camera makes its own.

Rendering takes most of a processor. In the program's own threads it would hold up everything that waits for
the interpreter, which no camera does.
"""

import contextlib
import logging
import queue
import subprocess
import sys
import threading
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any, TypeAlias

from app.simulation.exposure import SensorSettings
from app.simulation.stage import Moment
from app.simulation.world_plan import WorldPlan

_LINES = 2
_READY_S = 60.0
_PICTURE_S = 20.0
_Line: TypeAlias = "Connection[Any, bytes]"
_log = logging.getLogger(__name__)


class Studio:
    """The other process; safe from any thread, and never fails: without it pictures are made elsewhere.

    Args:
        plan: of the world.

    Attributes:
        is_closed: whether it was told to end.
    """

    def __init__(self, plan: WorldPlan) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._lines: queue.SimpleQueue[_Line] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self.is_closed = False
        pairs = [Pipe() for _ in range(_LINES)]
        numbers = [far.fileno() for _, far in pairs]
        try:
            # -P as for the watchdog: a folder called `app` where the program was started is not ours.
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", "app.devices.studio_process", *map(str, numbers)],
                stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, pass_fds=numbers,
            )  # fmt: skip
        except OSError as error:
            _log.warning("the simulated camera has no process of its own (%s)", error)
        for _, far in pairs:
            far.close()
        near = [near for near, _ in pairs]
        if self._process is None or not _is_ready(near[0], plan):
            self._end()
        for line in near:
            self._lines.put(line)

    @property
    def is_open(self) -> bool:
        return self._process is not None

    def picture(self, moment: Moment, settings: SensorSettings) -> bytes:
        """The camera's file of a moment; empty where the process has ended or could not make it."""
        line = self._lines.get()
        try:
            line.send((moment, settings))
            if not line.poll(_PICTURE_S):
                raise TimeoutError(f"no picture for {_PICTURE_S:.0f} s")
            data: bytes = line.recv()
        except (EOFError, OSError) as error:
            if self.is_open and not self.is_closed:
                _log.warning("the simulated camera's process has gone (%r)", error)
            self._end()
            return b""
        finally:
            self._lines.put(line)
        return data

    def close(self) -> None:
        """End the process; whoever waits for a picture gets none."""
        self.is_closed = True
        self._end()

    def _end(self) -> None:
        with self._lock:
            process, self._process = self._process, None
        if process is not None:
            # It has nothing to lose.
            process.kill()
            process.wait()


def _is_ready(line: _Line, plan: WorldPlan) -> bool:
    """Whether the process has made its first picture."""
    with contextlib.suppress(EOFError, OSError):
        line.send(plan)
        if line.poll(_READY_S):
            line.recv()
            return True
    _log.warning("the simulated camera's process did not start")
    return False
