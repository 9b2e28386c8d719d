"""Who has a port: a lock that a program holds alone, and that the watchdog of one that is gone shares.

pyserial locks ports of this computer itself, when it is asked to. An address in the network is locked by a
file that stands for it, among the programs of one user.
"""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path

try:
    import fcntl
except ImportError:
    # Windows gives a port to one program alone.
    fcntl = None  # type: ignore[assignment]
_CAN_LOCK = fcntl is not None


@contextmanager
def held_alone(port: str) -> Iterator[None]:
    """An address is nobody else's inside the block; nothing is done about other ports.

    Raises:
        BlockingIOError: somebody has it.
    """
    if not _CAN_LOCK or not _is_address(port):
        yield
        return
    try:
        handle = _opened(port)
    except OSError:
        # No place for such files.
        yield
        return
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    finally:
        os.close(handle)


@contextmanager
def shared(port: str) -> Iterator[None]:
    """Nobody may have the port alone inside the block.

    Raises:
        OSError: somebody has, or it is not there.
    """
    if not _CAN_LOCK:
        yield
        return
    # Asked before anything else is done to the port, because opening it throws away what has arrived.
    handle = _opened(port)
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
        yield
    finally:
        os.close(handle)


def is_shared(port: str) -> bool:
    """Whether others share a port that could not be had alone."""
    if not _CAN_LOCK:
        return False
    try:
        with shared(port):
            pass
    except OSError:
        return False
    return True


def _opened(port: str) -> int:
    if not _is_address(port):
        return os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    name = f"turnscan-{os.getuid()}-{sha256(port.encode()).hexdigest()[:16]}.lock"
    return os.open(Path(tempfile.gettempdir(), name), os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)


def _is_address(port: str) -> bool:
    return "://" in port
