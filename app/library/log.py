"""`log.txt`: what was done with a scan, one line each; it lies in the scan's folder and travels with it."""

import os
from datetime import UTC, datetime
from pathlib import Path

from app.errors import OutputError
from app.files import reason
from app.library.about import moment

LOG_FILE = "log.txt"
_MOST_BYTES = 1 << 20


def write_line(folder: Path, words: str) -> None:
    """Add a line, with the time before it.

    Raises:
        OutputError: it cannot be written.
    """
    line = f"{moment(datetime.now(UTC))} {' '.join(words.split())}\n"
    flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0)
    try:
        with os.fdopen(os.open(folder / LOG_FILE, flags, 0o666), "ab") as file:
            file.write(line.encode("utf-8", "replace"))
    except OSError as error:
        raise OutputError(str(folder / LOG_FILE), reason(error)) from error


def read_log(folder: Path) -> tuple[str, ...]:
    """Its lines, oldest first; the newest megabyte of a very long one, nothing where there is none.

    Raises:
        OutputError: it is there and cannot be read.
    """
    path = folder / LOG_FILE
    if path.is_symlink() or not path.is_file():
        return ()
    try:
        with path.open("rb") as file:
            start = max(0, path.stat().st_size - _MOST_BYTES)
            file.seek(start)
            lines = file.read(_MOST_BYTES).decode("utf-8", "replace").splitlines()
    except OSError as error:
        raise OutputError(str(path), reason(error)) from error
    return tuple(lines[1:] if start else lines)
