import threading
import time
from collections.abc import Iterator

import pytest

from app.scanning.pipeline import ordered_map


def test_results_keep_the_order_of_the_items() -> None:
    assert list(ordered_map(lambda k: k * k, range(200), workers=3)) == [k * k for k in range(200)]


def test_only_a_few_items_are_under_way() -> None:
    taken = 0

    def items() -> Iterator[int]:
        nonlocal taken
        for k in range(1000):
            taken += 1
            yield k

    results = ordered_map(lambda k: k, items(), workers=2, ahead=3)
    for done, _ in zip(range(50), results, strict=False):
        assert taken <= done + 1 + 2 + 3
    results.close()


def test_a_result_does_not_wait_for_the_items_that_are_still_to_come() -> None:
    may_go_on = threading.Event()

    def items() -> Iterator[int]:
        yield 1
        assert may_go_on.wait(60.0)
        yield 2

    results = ordered_map(lambda k: k, items(), workers=2)
    assert next(results) == 1
    may_go_on.set()
    assert list(results) == [2]


def test_an_error_of_the_items_arrives_after_the_results_of_those_before() -> None:
    def items() -> Iterator[int]:
        yield 1
        raise KeyError(2)

    results = ordered_map(lambda k: k, items(), workers=2)
    assert next(results) == 1
    with pytest.raises(KeyError):
        next(results)


def test_an_error_at_the_end_of_the_items_arrives_too() -> None:
    class Items:
        def __iter__(self) -> Iterator[int]:
            return self

        def __next__(self) -> int:
            raise StopIteration

        def close(self) -> None:
            raise KeyError("farewell")

    with pytest.raises(KeyError, match="farewell"):
        list(ordered_map(lambda k: k, Items(), workers=2))


def test_an_error_arrives_at_its_place_and_ends_the_threads() -> None:
    def work(k: int) -> int:
        if k == 5:
            raise KeyError(k)
        return k

    results = ordered_map(work, range(100), workers=2)
    assert [next(results) for _ in range(5)] == [0, 1, 2, 3, 4]
    with pytest.raises(KeyError):
        next(results)
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("stripes")]


def test_an_interrupted_reader_leaves_no_thread_behind() -> None:
    results = ordered_map(lambda k: k, range(1000), workers=2)
    next(iter(results))
    results.close()
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("stripes")]


def test_nothing_comes_of_nothing() -> None:
    assert list(ordered_map(time.sleep, [], workers=2)) == []
