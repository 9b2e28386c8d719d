"""Work spread over a few threads, handed on in order, never more of it under way than a few items."""

import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from queue import SimpleQueue
from typing import Generic, TypeVar

T = TypeVar("T")
U = TypeVar("U")


def ordered_map(function: Callable[[T], U], items: Iterable[T], workers: int, ahead: int = 2) -> Generator[U]:
    """`map` in threads; results come in order, each as soon as it and those before are there.

    Closing the generator, or an exception anywhere, ends the threads after the items they are at.

    Args:
        function: called in a thread.
        items: taken one by one, in a thread; may be slow to come.
        workers: number of threads.
        ahead: how many finished items may wait.
    """
    feeder = _Feeder(function, items, workers, ahead)
    try:
        while (result := feeder.results.get()) is not None:
            yield result.result()
            feeder.room.release()
    finally:
        feeder.close()


class _Feeder(Generic[T, U]):
    """Takes items while there is room; futures of the results, in order, then None."""

    def __init__(self, function: Callable[[T], U], items: Iterable[T], workers: int, ahead: int) -> None:
        self.results: SimpleQueue[Future[U] | None] = SimpleQueue()
        self.room = threading.Semaphore(workers + ahead)
        self._function, self._items, self._is_over = function, items, False
        self._pool = ThreadPoolExecutor(max_workers=workers, thread_name_prefix="stripes")
        self._thread = threading.Thread(target=self._run, name="stripes feeder", daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._is_over = True
        self.room.release()
        self._thread.join()
        self._pool.shutdown(wait=True, cancel_futures=True)

    def _run(self) -> None:
        try:
            source = iter(self._items)
            with ExitStack() as ending:
                if (close := getattr(source, "close", None)) is not None:
                    ending.callback(close)
                self._feed(source)
        except BaseException as error:  # noqa: BLE001 (edge of a thread: raised where results are taken)
            broken: Future[U] = Future()
            broken.set_exception(error)
            self.results.put(broken)
        finally:
            self.results.put(None)

    def _feed(self, source: Iterator[T]) -> None:
        self.room.acquire()
        for item in source:
            self.results.put(self._pool.submit(self._function, item))
            self.room.acquire()
            if self._is_over:
                break
