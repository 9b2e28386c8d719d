"""How loops are compiled: on first use, kept on disk where that can be written."""

from collections.abc import Callable
from typing import Any, TypeVar

import numba

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """The function as machine code, without the interpreter's lock, so that threads run beside each other."""
    return _jit(function, False)


def compiled_loosely(function: F) -> F:
    """The same, with sums taken in any order: that is what vectors need, and moves the last digit only."""
    return _jit(function, {"reassoc", "contract", "nsz"})


def _jit(function: F, fastmath: bool | set[str]) -> F:
    options = {"nogil": True, "error_model": "numpy", "fastmath": fastmath}
    try:
        kept: F = numba.njit(cache=True, **options)(function)
    except RuntimeError:
        # No place to keep the machine code: neither beside the source nor in the user's cache directory.
        fresh: F = numba.njit(**options)(function)
        return fresh
    return kept
