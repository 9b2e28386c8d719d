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
    results.close()  # type: ignore[attr-defined]


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
    results.close()  # type: ignore[attr-defined]
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("stripes")]


def test_nothing_comes_of_nothing() -> None:
    assert list(ordered_map(time.sleep, [], workers=2)) == []
