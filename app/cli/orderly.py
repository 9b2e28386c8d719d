"""A way out that is not interrupted."""

import contextlib
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def orderly() -> Iterator[None]:
    """Every request to end is a KeyboardInterrupt, once; the way out itself is not interrupted."""
    is_ending = False

    def end(number: int, frame: FrameType | None) -> None:
        nonlocal is_ending
        if not is_ending:
            is_ending = True
            raise KeyboardInterrupt

    names = [name for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    with contextlib.ExitStack() as stack:
        for name in names:
            number = getattr(signal, name)
            stack.callback(signal.signal, number, signal.signal(number, end))
        yield
