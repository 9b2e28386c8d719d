"""Recordings shared out among processes of this machine; one that dies takes only its own recording along."""

import multiprocessing
import signal
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from types import FrameType
from typing import TypeAlias

from app.batch.one import make_thing
from app.batch.order import BatchOrder
from app.batch.places import Task
from app.batch.result import Result

# A forked process would inherit locks that threads of this one hold.
_CONTEXT = multiprocessing.get_context("spawn")
_FAREWELL_S = 10.0

TellTask: TypeAlias = Callable[[Task, str, float], None]
"""Told of a task what is being done and which share of it is done."""


def in_processes(
    tasks: Sequence[Task], order: BatchOrder, workers: int, tell: TellTask
) -> Iterator[tuple[Task, Result]]:
    """Make things of all recordings, some at once; each with its result, in the order in which they end.

    Closing the iterator early ends the processes; what they had not finished is not there.

    Args:
        tasks: what is to be done.
        order: how.
        workers: processes at once.
        tell: told how each goes.
    """
    waiting = deque(tasks)
    desks = [_Desk(order) for _ in range(min(workers, len(tasks)))]
    try:
        for desk in desks:
            desk.give(waiting.popleft())
        while busy := {desk.line: desk for desk in desks if desk.task is not None}:
            for line in wait(list(busy)):
                assert isinstance(line, Connection)
                desk = busy[line]
                task = desk.task
                assert task is not None
                result = desk.heard(tell)
                if result is None:
                    continue
                if waiting:
                    desk.give(waiting.popleft())
                yield task, result
    finally:
        for desk in desks:
            desk.close()


class _Desk:
    """A place to work at: a process that begins with the first task, and another when it has died."""

    def __init__(self, order: BatchOrder) -> None:
        self._order = order.model_dump_json()
        self.task: Task | None = None
        self._seat: _Seat | None = None

    @property
    def line(self) -> Connection:
        """To the process; there from the first task on."""
        assert self._seat is not None
        return self._seat.line

    def give(self, task: Task) -> None:
        """The next task, when there is none any more."""
        self.task = task
        self._seat = self._seat or _Seat()
        # One that died while it had nothing to do will be heard of as dead.
        with suppress(OSError):
            self.line.send((str(task.recording), str(task.folder), self._order))

    def heard(self, tell: TellTask) -> Result | None:
        """What the process has to say: the result of its task, or how far it is."""
        assert self.task is not None
        try:
            news = self.line.recv()
        except (EOFError, OSError):
            result = self._died(self.task)
        else:
            if isinstance(news, tuple):
                tell(self.task, *news)
                return None
            result = Result.model_validate_json(news)
        self.task = None
        return result

    def close(self) -> None:
        """End the process, whatever it is doing."""
        if self._seat is not None:
            self._seat.close()
        self._seat = None

    def _died(self, task: Task) -> Result:
        assert self._seat is not None
        self._seat.process.join(_FAREWELL_S)
        code = self._seat.process.exitcode
        self.close()
        how = f"was ended by signal {-code}" if code is not None and code < 0 else f"ended with code {code}"
        return Result(
            recording=str(task.recording),
            problem=f"The process that worked on it {how}.",
            hint="Often the memory was full: use fewer --workers or a coarser --detail, and run it again.",
        )


class _Seat:
    """A process and the line to it."""

    def __init__(self) -> None:
        self.line, far_end = _CONTEXT.Pipe()
        self.process = _CONTEXT.Process(target=_work, args=(far_end,), daemon=True)
        self.process.start()
        far_end.close()

    def close(self) -> None:
        self.process.terminate()
        self.process.join(_FAREWELL_S)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()
        self.line.close()


def _work(line: Connection) -> None:
    """What each process does until nobody is there any more."""
    # Ctrl-C reaches every process of a terminal; the one that gave the work decides.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _leave)

    def tell(words: str, share: float) -> None:
        try:
            line.send((words, share))
        except OSError:
            raise SystemExit(0) from None

    while True:
        try:
            recording, folder, order = line.recv()
            line.send(make_thing(recording, folder, order, tell))
        except (EOFError, OSError):
            return


def _leave(number: int, frame: FrameType | None) -> None:
    """Half-written files go on the way out."""
    raise SystemExit(0)
