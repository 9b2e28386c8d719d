"""How loops are compiled: on first use, kept on disk where that can be written."""

from collections.abc import Callable
from typing import Any, TypeVar

import numba

F = TypeVar("F", bound=Callable[..., Any])

_ANY_ORDER = {"reassoc", "contract", "nsz"}


def compiled(function: F) -> F:
    """The function as machine code, without the interpreter's lock, so that threads run beside each other."""
    return _jit(function, False)


def compiled_loosely(function: F) -> F:
    """The same, with sums taken in any order: that is what vectors need, and moves the last digit only."""
    return _jit(function, _ANY_ORDER)


def compiled_briefly(function: F) -> F:
    """For loops of some microseconds: to let other threads in for so long costs more than it brings."""
    return _jit(function, False, nogil=False)


def inlined(function: F) -> F:
    """A part of loops: always taken into them, since handing arrays on costs more than reading a line."""
    return _jit(function, False, forceinline=True)


def inlined_loosely(function: F) -> F:
    """The same for sums taken in any order."""
    return _jit(function, _ANY_ORDER, forceinline=True)


def _jit(function: F, fastmath: bool | set[str], **more: bool) -> F:
    options = {"nogil": True, "error_model": "numpy", "fastmath": fastmath, **more}
    try:
        kept: F = numba.njit(cache=True, **options)(function)
    except RuntimeError:
        # No place to keep the machine code: neither beside the source nor in the user's cache directory.
        fresh: F = numba.njit(**options)(function)
        return fresh
    return kept
