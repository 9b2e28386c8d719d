"""Files that are either whole or not there: written beside the target, then renamed over it."""

import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import BinaryIO

from app.errors import OutputError


def write_whole(path: Path, data: bytes, *, is_durable: bool = True, mode: int | None = None) -> None:
    """Put the bytes at `path`; a reader sees the old file or the new one, never a part.

    Args:
        path: where to; its folder must exist.
        data: everything.
        is_durable: wait until the disk has it, so that it also survives a loss of power.
        mode: who may read and write it; by default whoever the system lets.

    Raises:
        OutputError: the disk is full, the folder is missing or may not be written.
    """
    with replacing(path, is_durable=is_durable, mode=mode) as file:
        file.write(data)


@contextmanager
def replacing(path: Path, *, is_durable: bool = True, mode: int | None = None) -> Iterator[BinaryIO]:
    """A file to write that takes the place of `path` when the block ends well, and vanishes otherwise.

    Raises:
        OutputError: any failure of the file system, in the block or while renaming.
    """
    beside: Path | None = None
    try:
        handle, name = tempfile.mkstemp(prefix=f".{path.name[:100]}.", suffix=".part", dir=path.parent)
        beside = Path(name)
        with os.fdopen(handle, "w+b") as file:
            yield file
            file.flush()
            if is_durable:
                os.fsync(file.fileno())
        beside.chmod(0o666 & ~_umask() if mode is None else mode)
        beside.replace(path)
        beside = None
    except OSError as error:
        raise OutputError(str(path), reason(error)) from error
    finally:
        if beside is not None:
            beside.unlink(missing_ok=True)


@contextmanager
def together(paths: Sequence[Path]) -> Iterator[Mapping[Path, Path]]:
    """Several files that all take their places when the block ends well, and otherwise none of them.

    Args:
        paths: where they belong, each once.

    Yields:
        For each of them where it is to be written: under its own name, in a hidden folder beside its place.

    Raises:
        OutputError: any failure of the file system, naming the file by its own place.
    """
    with ExitStack() as folders:
        beside: dict[Path, Path] = {}
        rooms: dict[Path, Path] = {}
        for path in paths:
            try:
                if path.parent not in rooms:
                    room = tempfile.TemporaryDirectory(
                        prefix=".turnscan.", suffix=".part", dir=path.parent, ignore_cleanup_errors=True
                    )
                    rooms[path.parent] = Path(folders.enter_context(room))
            except OSError as error:
                raise OutputError(str(path), reason(error)) from error
            beside[path] = rooms[path.parent] / path.name
        try:
            yield beside
        except OutputError as error:
            own = {str(place): path for path, place in beside.items()}.get(error.where)
            if own is None:
                raise
            raise OutputError(str(own), error.problem, error.hint) from error
        for path, place in beside.items():
            try:
                place.replace(path)
            except OSError as error:
                raise OutputError(str(path), reason(error)) from error


def make_folder(path: Path) -> None:
    """Make a folder and those above it; one that is there already is fine.

    Raises:
        OutputError: it cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(str(path), reason(error)) from error


def reason(error: OSError) -> str:
    """What the system says went wrong, without the number and the path: `no space left on device`."""
    text = error.strerror or str(error)
    return text[:1].lower() + text[1:]


def _umask() -> int:
    # The only portable way to ask is to set it.
    mask = os.umask(0o022)
    os.umask(mask)
    return mask
