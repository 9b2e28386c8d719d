"""The process that makes the simulated camera's pictures; started by `app.devices.studio`.

Started as `python -m app.devices.studio_process FD...` with the numbers of open sockets, its lines. The first
one brings the plan of the world, and is answered once a first picture has been made. Then each line brings
what a picture shows and is answered with the file, or with nothing where it could not be made. It ends when
the other ends are closed, so with the program, however that ends.
"""

import contextlib
import logging
import signal
import sys
import threading
from multiprocessing.connection import Connection

import cv2

from app.allocator import share_arenas
from app.recording.picture import encode
from app.simulation.exposure import SensorSettings
from app.simulation.stage import Moment, Stage
from app.simulation.world_plan import WorldPlan

_log = logging.getLogger(__name__)


def main(numbers: list[str]) -> None:
    """Make pictures until nobody asks any more."""
    # These reach the whole group of processes, and the program may need pictures until its own end.
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        signal.signal(getattr(signal, name), signal.SIG_IGN)
    share_arenas()
    # Each line has a thread of its own.
    cv2.setNumThreads(1)
    lines = [Connection(int(number)) for number in numbers]
    with contextlib.suppress(EOFError, OSError):
        plan: WorldPlan = lines[0].recv()
        stage = Stage(plan)
        stage.rehearse()
        lines[0].send(b"")
        threads = [threading.Thread(target=_answer, args=(line, stage, plan)) for line in lines]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()


def _answer(line: "Connection[bytes, tuple[Moment, SensorSettings]]", stage: Stage, plan: WorldPlan) -> None:
    with contextlib.suppress(EOFError, OSError):
        while True:
            moment, settings = line.recv()
            try:
                data = encode(stage.picture(moment, settings), "jpeg", plan.jpeg_quality)
            except Exception:  # noqa: BLE001 (edge of a process: whoever asked makes it, and hears why not)
                _log.exception("a picture could not be made")
                data = b""
            line.send(data)


if __name__ == "__main__":
    main(sys.argv[1:])
