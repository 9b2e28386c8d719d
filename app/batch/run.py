"""A whole batch: what is done already is left, the rest is shared out, and a table tells the outcome."""

from collections.abc import Generator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from app.batch.cluster import on_cluster
from app.batch.fingerprint import fingerprint
from app.batch.order import BatchOrder
from app.batch.places import Task, tasks_for
from app.batch.pool import in_processes
from app.batch.result import Outcome, Result, read_result
from app.batch.table import Row, write_tables
from app.errors import OutputError, ScannerError
from app.files import make_folder, reason
from app.locks import lock

_LOCK_FILE = ".batch.lock"


class Watch(Protocol):
    """Told how a batch goes."""

    def found(self, kept: int, waiting: int) -> None:
        """So many were done before; so many are to be made."""

    def going(self, name: str, words: str, share: float) -> None:
        """What is being done with one of them, and which share of it is done."""

    def ended(self, name: str, result: Result) -> None:
        """One of them has ended, well or not."""


@dataclass(frozen=True, slots=True)
class BatchPlan:
    """How a batch is worked off.

    Attributes:
        order: what is made of each recording.
        out: the folder for everything.
        workers: processes at once; of no effect where there is a scheduler.
        scheduler: address of a Dask cluster's; empty for this machine.
        again: make also what is done.
    """

    order: BatchOrder
    out: Path
    workers: int = 1
    scheduler: str = ""
    again: bool = False


def run_batch(recordings: Sequence[Path], plan: BatchPlan, watch: Watch) -> list[Row]:
    """Make things of recordings; `results.csv` and `results.html` in the folder tell what became of each.

    The tables are written however it ends, an interruption included: then of what was reached.

    Raises:
        OutputError: the folder cannot be used, or another batch works there.
        OptionError: the cluster cannot be reached.
    """
    make_folder(plan.out)
    try:
        held = (plan.out / _LOCK_FILE).open("wb")
    except OSError as error:
        raise OutputError(str(plan.out), reason(error)) from error
    with held:
        if not lock(held):
            raise OutputError(
                str(plan.out),
                "another batch works in this folder",
                "Wait for its end, or name another --out.",
            )
        tasks = tasks_for(recordings, plan.out)
        results = {task: kept for task in tasks if (kept := _kept(task, plan)) is not None}
        waiting = [task for task in tasks if task not in results]
        watch.found(len(results), len(waiting))
        try:
            with closing(_made(waiting, plan, watch)) as made:
                for task, result in made:
                    results[task] = result
                    watch.ended(task.name, result)
        finally:
            rows = [Row(task, results.get(task)) for task in tasks]
            write_tables(plan.out, rows)
    return rows


def _kept(task: Task, plan: BatchPlan) -> Result | None:
    """What an earlier run made of the same recording with the same settings; what failed is tried again."""
    result = None if plan.again else read_result(task.folder)
    if result is None or result.outcome is Outcome.FAILED:
        return None
    if not all((task.folder / name).is_file() for name in result.files):
        return None
    try:
        return result if result.fingerprint == fingerprint(task.recording, plan.order) else None
    except ScannerError:
        # Whoever works on it says what is wrong.
        return None


def _made(tasks: Sequence[Task], plan: BatchPlan, watch: Watch) -> Generator[tuple[Task, Result]]:
    if not plan.scheduler:
        yield from in_processes(
            tasks, plan.order, plan.workers, lambda task, words, share: watch.going(task.name, words, share)
        )
    elif tasks:
        yield from on_cluster(tasks, plan.order, plan.scheduler)
