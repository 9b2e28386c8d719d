"""How the C library keeps memory that a program has given back."""

import ctypes
import logging
import sys

# Of glibc's malloc.h.
_M_MMAP_THRESHOLD = -3
# Pictures are larger, and come and go in many threads.
_LARGE_BYTES = 1 << 20
_log = logging.getLogger(__name__)


def return_large_blocks() -> bool:
    """Have the memory of pictures given back to the system as soon as they are forgotten.

    glibc otherwise raises the size from which it does so up to 32 MB and keeps what is smaller for each
    thread: a server that takes pictures in many threads then holds twice as much as it needs (mallopt(3)).

    Returns:
        Whether this system's C library could be told.
    """
    if not sys.platform.startswith("linux"):
        return False
    try:
        told = bool(ctypes.CDLL(None).mallopt(_M_MMAP_THRESHOLD, _LARGE_BYTES))
    except (OSError, AttributeError):
        told = False
    if not told:
        _log.debug("the C library cannot be told how to keep memory")
    return told
