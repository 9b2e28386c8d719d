"""Taking the word from a thread that waits for the end of a move."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import wraps
from typing import Concatenate, ParamSpec, Protocol, TypeVar

from app.devices.serial_link import SerialLink
from app.errors import DeviceError

_TRY_S = 0.1

P = ParamSpec("P")
R = TypeVar("R")


class Linked(Protocol):
    """A driver over a serial link."""

    _link: SerialLink


D = TypeVar("D", bound=Linked)


def alone(stop: Callable[Concatenate[D, P], R]) -> Callable[Concatenate[D, P], R]:
    """A driver's method that stops the board; two threads that want it at once come one after the other."""

    @wraps(stop)
    def one_after_the_other(driver: D, /, *args: P.args, **options: P.kwargs) -> R:
        with driver._link.overtaker:
            return stop(driver, *args, **options)

    return one_after_the_other


@contextmanager
def overtaking(link: SerialLink) -> Iterator[None]:
    """A dialogue for which whoever waits gives up with `MoveStopped`, now or when it begins to wait.

    A second one who overtakes waits until the first is done.
    """
    with link.overtaker, ExitStack() as stack:
        while True:
            link.interrupt()
            try:
                stack.enter_context(link.dialogue(wait_s=_TRY_S))
            except DeviceError:
                continue
            break
        yield
