"""How loops are compiled: on first use, kept on disk where that can be written."""

from collections.abc import Callable
from typing import Any, TypeVar

import numba

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """The function as machine code, without the interpreter's lock, so that threads run beside each other."""
    try:
        return _jit(function, True)
    except RuntimeError:
        # No place to keep the machine code: neither beside the source nor in the user's cache directory.
        return _jit(function, False)


def _jit(function: F, is_cached: bool) -> F:
    jitted: F = numba.njit(cache=is_cached, nogil=True, error_model="numpy")(function)
    return jitted
