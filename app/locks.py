"""Locks on open files: they end with the program that holds them, however that ends."""

import os
import sys
import time
from pathlib import Path
from typing import BinaryIO

_RETRY_S = 0.02
# Windows locks bytes, and refuses to read them: one far behind the end of every file.
_FAR = 1 << 40


def lock(file: BinaryIO, patience_s: float = 0.0) -> bool:
    """Hold the file until it is closed; False where another still holds it when the patience ends.

    Two open files exclude each other in one program, too. On a file system without locks everybody gets one.
    """
    give_up = time.monotonic() + patience_s
    while not _try(file.fileno()):
        if time.monotonic() >= give_up:
            return False
        time.sleep(_RETRY_S)
    return True


def is_locked(path: Path) -> bool:
    """Whether somebody holds that file now; one that is not there is not held."""
    try:
        with path.open("rb") as file:
            return not lock(file)
    except OSError:
        return False


if sys.platform == "win32":
    import msvcrt

    def _try(handle: int) -> bool:
        place = os.lseek(handle, 0, os.SEEK_CUR)
        os.lseek(handle, _FAR, os.SEEK_SET)
        try:
            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        finally:
            os.lseek(handle, place, os.SEEK_SET)
        return True

else:
    import fcntl

    def _try(handle: int) -> bool:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError:
            return True
        return True
