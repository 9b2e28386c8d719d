"""How much is taken in from elsewhere, before any of it is written."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from app.errors import ImportFailed, OutputError
from app.library.library import free_bytes

Progress = Callable[[int, int], None]
"""Told how many bytes of how many are done."""

_SPARE_BYTES = 64_000_000
_LONGEST_PART = 200
_DEEPEST = 12
_NOT_WANTED = frozenset({"__MACOSX", "Thumbs.db", "desktop.ini"})
_HINT = "Name a folder or a zip file with one recording in it, or a PLY file."


@dataclass(frozen=True, slots=True)
class Limits:
    """What is too much.

    Attributes:
        entries: files and folders.
        total_bytes: of all files.
        cloud_bytes: of one cloud, which is read as a whole.
        expansion: how many times larger than its zip file a scan may be; pictures do not shrink.
    """

    entries: int = 100_000
    total_bytes: int = 64_000_000_000
    cloud_bytes: int = 4_000_000_000
    expansion: int = 50


def refused(where: str, problem: str, hint: str = _HINT) -> ImportFailed:
    """Why something is not taken in, in one sentence."""
    return ImportFailed(f"{where}: {problem}", hint)


def is_wanted(path: PurePosixPath) -> bool:
    """Whether a file belongs to a scan: hidden files and what systems leave in folders do not."""
    return not any(part.startswith(".") or part in _NOT_WANTED for part in path.parts)


def check_name(where: str, name: str) -> PurePosixPath:
    """A file's path inside a scan, judged as every system would.

    Raises:
        ImportFailed: it leads elsewhere or is no name.
    """
    shown = ascii(name[:60])
    if name.startswith("/") or "\\" in name or (len(name) > 1 and name[1] == ":"):
        raise refused(where, f"holds a file whose name is absolute or of another system: {shown}")
    parts = name.rstrip("/").split("/")
    if ".." in parts:
        raise refused(where, f"holds a file whose name leads out of its folder: {shown}")
    for part in parts:
        is_long = len(part.encode("utf-8", "replace")) > _LONGEST_PART
        if not part or part == "." or is_long or not part.isprintable() or ":" in part:
            raise refused(where, f"holds a file whose name cannot be used: {shown}")
    if len(parts) > _DEEPEST:
        raise refused(where, f"holds folders in folders, more than {_DEEPEST} deep: {shown}")
    return PurePosixPath(*parts)


def check_amount(where: str, entries: int, total_bytes: int, limits: Limits) -> None:
    """Raise ImportFailed where that is too much."""
    if entries > limits.entries:
        raise refused(where, f"holds more than {limits.entries:,} files")
    if total_bytes > limits.total_bytes:
        raise refused(where, f"holds more than {in_words(limits.total_bytes)}")


def check_room(folder: Path, needed_bytes: int) -> None:
    """Raise OutputError where the disk has no room for that much, with some to spare."""
    free = free_bytes(folder)
    if needed_bytes + _SPARE_BYTES > free:
        raise OutputError(
            str(folder), f"has no room for {in_words(needed_bytes)}: {in_words(free)} are free",
            "Empty the bin with `turnscan library empty`, or free some space.",
        )  # fmt: skip


def in_words(size: float) -> str:
    """`3.4 MB`."""
    for unit in ("bytes", "kB", "MB", "GB"):
        if size < 1000:
            return f"{size:.0f} {unit}" if unit == "bytes" or size >= 100 else f"{size:.1f} {unit}"
        size /= 1000
    return f"{size:.1f} TB"
