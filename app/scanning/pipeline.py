"""Work spread over a few threads, handed on in order, never more of it under way than a few items."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import islice
from typing import TypeVar

T = TypeVar("T")
U = TypeVar("U")


def ordered_map(function: Callable[[T], U], items: Iterable[T], workers: int, ahead: int = 2) -> Iterator[U]:
    """`map` in threads; results come in the order of the items.

    Closing the generator, or an exception anywhere, ends the threads after the items they are at.

    Args:
        function: called in a thread.
        items: taken one by one, in the caller's thread.
        workers: number of threads.
        ahead: how many finished items may wait.
    """
    under_way: deque[Future[U]] = deque()
    source = iter(items)
    pool = ThreadPoolExecutor(max_workers=workers, thread_name_prefix="stripes")
    try:
        for item in islice(source, workers + ahead):
            under_way.append(pool.submit(function, item))
        while under_way:
            result = under_way.popleft().result()
            for item in islice(source, 1):
                under_way.append(pool.submit(function, item))
            yield result
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
