"""Changing a library: one program at a time, and everything unfinished out of sight.

What takes long happens in a work folder inside the library, so that the last step is one renaming. A program
that is killed leaves its work folder behind, unlocked; the next one that works sweeps it away.
"""

import os
import shutil
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from app.errors import LibraryError, OutputError
from app.files import make_folder, reason
from app.locks import lock

WORK_FOLDER = ".work"
_LOCK_FILE = ".lock"
_HOLD = ".held"
_PATIENCE_S = 10.0


@contextmanager
def changing(folder: Path) -> Iterator[None]:
    """Nobody else renames anything in the library meanwhile.

    Raises:
        LibraryError: another program does not come to an end.
        OutputError: the folder cannot be written.
    """
    make_folder(folder)
    try:
        file = (folder / _LOCK_FILE).open("ab")
    except OSError as error:
        raise OutputError(str(folder), reason(error)) from error
    with file:
        if not lock(file, _PATIENCE_S):
            raise LibraryError(f"Another program is changing {folder}.", "Wait a moment, then try again.")
        yield


@contextmanager
def work_folder(folder: Path) -> Iterator[Path]:
    """A new folder beside the scans; what is still in it when the block ends is erased.

    Raises:
        OutputError: it cannot be made, or not erased.
    """
    work = folder / WORK_FOLDER / uuid.uuid4().hex
    make_folder(work.parent)
    try:
        with changing(folder):
            held = work.with_suffix(_HOLD).open("xb")
            lock(held)
        try:
            with suppress(OutputError):
                sweep(folder)
            work.mkdir()
            yield work
        finally:
            _erase(work)
            held.close()
            work.with_suffix(_HOLD).unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(str(folder), reason(error)) from error


def sweep(folder: Path) -> None:
    """Erase what killed programs left behind. Raises OutputError."""
    with changing(folder):
        left = [hold for hold in (folder / WORK_FOLDER).glob(f"*{_HOLD}") if _is_abandoned(hold)]
    for hold in left:
        _erase(hold.with_suffix(""))
        hold.unlink(missing_ok=True)


def settle() -> None:
    """Have the disk take everything, so that a renaming that follows cannot come before it."""
    if hasattr(os, "sync"):
        os.sync()


def _is_abandoned(hold: Path) -> bool:
    with suppress(FileNotFoundError), hold.open("rb") as file:
        return lock(file)
    return False


def _erase(work: Path) -> None:
    try:
        shutil.rmtree(work)
    except FileNotFoundError:
        return
    except OSError as error:
        raise OutputError(str(work), reason(error)) from error
