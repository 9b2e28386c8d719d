"""How the C library keeps memory that a program has given back."""

import ctypes
import logging
import sys

# Of glibc's malloc.h.
_M_ARENA_MAX = -8
_ARENAS = 2
_log = logging.getLogger(__name__)


def share_arenas() -> bool:
    """Have all threads take memory from the same few stores.

    glibc otherwise gives up to eight stores to each processor, and each keeps what its threads gave back: a
    server that takes pictures in many threads then holds twice as much as it needs (mallopt(3)). Call it
    before there are many threads.

    Returns:
        Whether this system's C library could be told.
    """
    if not sys.platform.startswith("linux"):
        return False
    try:
        told = bool(ctypes.CDLL(None).mallopt(_M_ARENA_MAX, _ARENAS))
    except (OSError, AttributeError):
        told = False
    if not told:
        _log.debug("the C library cannot be told how to keep memory")
    return told
