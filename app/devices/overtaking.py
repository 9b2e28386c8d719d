"""Taking the word from a thread that waits for the end of a move."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from app.devices.serial_link import SerialLink
from app.errors import DeviceError

_TRY_S = 0.1


@contextmanager
def overtaking(link: SerialLink) -> Iterator[None]:
    """A dialogue for which whoever waits gives up with `MoveStopped`, now or when it begins to wait."""
    with ExitStack() as stack:
        while True:
            link.interrupt()
            try:
                stack.enter_context(link.dialogue(wait_s=_TRY_S))
            except DeviceError:
                continue
            break
        yield
