"""Recordings shared out among the workers of a Dask cluster, which see the same folders as this machine."""

import logging
from collections.abc import Iterator, Sequence
from typing import Any

from app.batch.one import make_thing
from app.batch.order import BatchOrder
from app.batch.places import Task
from app.batch.result import Result
from app.errors import OptionError

_PATIENCE_S = 30.0


def on_cluster(tasks: Sequence[Task], order: BatchOrder, scheduler: str) -> Iterator[tuple[Task, Result]]:
    """Make things of all recordings; each with its result, in the order in which they end.

    What a worker that dies was working on is given to another one, three times at most. Closing the iterator
    early takes back what no worker has begun.

    Args:
        tasks: what is to be done.
        order: how.
        scheduler: its address, such as `tcp://host:8786`.

    Raises:
        OptionError: Dask is not installed, or nobody answers at that address.
    """
    try:
        from distributed import Client, as_completed
    except ImportError:
        raise OptionError(
            "--scheduler needs Dask, which is not installed.", "Install it with: pip install '.[cluster]'."
        ) from None
    # It logs what is told in a sentence here, as tracebacks.
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    try:
        client = Client(scheduler, timeout=_PATIENCE_S, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise OptionError(
            f"No Dask scheduler answers at {scheduler[:200]!r}: {error}.",
            "Start one with `dask scheduler`, and name the address that it prints.",
        ) from error
    text = order.model_dump_json()
    with client:
        of = {
            client.submit(make_thing, str(task.recording), str(task.folder), text, pure=False): task
            for task in tasks
        }
        try:
            for future in as_completed(list(of), loop=client.loop):
                yield of[future], _result(of[future], future)
        finally:
            client.cancel(list(of))


def _result(task: Task, future: Any) -> Result:
    if future.cancelled():
        return Result(
            recording=str(task.recording),
            problem="The scheduler of the cluster went away before it was done.",
            hint="Start the scheduler and its workers again, then run the same command.",
        )
    error = future.exception()
    if error is None:
        return Result.model_validate_json(future.result())
    return Result(
        recording=str(task.recording),
        problem=f"No worker of the cluster brought it to an end: {type(error).__name__}.",
        hint="Look at the workers' logs: often the memory was full, or the program is not installed there.",
    )
