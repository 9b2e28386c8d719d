"""A folder as a zip file that is made while it is sent: nothing is built on disk or in memory.

Pictures are compressed already, so files are stored as they are; the length is known before the first byte.
"""

import io
import os
import time
import zipfile
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, TypeAlias

from app.errors import OutputError
from app.files import reason

_CHUNK_BYTES = 1 << 18
_EARLIEST, _LATEST = (1980, 1, 1, 0, 0, 0), (2107, 12, 31, 23, 59, 58)
_HINT = "Try again when nobody changes the scan."
# Records of the format: see sections 4.3 and 4.5.3 of the ZIP file format specification, version 6.3.10.
_LOCAL, _CENTRAL, _END, _END_64 = 30, 46, 22, 76
_DESCRIPTOR, _DESCRIPTOR_64, _LOCAL_64 = 16, 24, 20
_Open: TypeAlias = Callable[[str], BinaryIO]


@dataclass(frozen=True, slots=True)
class _Member:
    path: str
    name: str
    size: int
    modified_s: float


class ZipStream:
    """A folder, files whose names begin with a dot left out, as the bytes of a zip file.

    Args:
        folder: what is sent; nobody may change its files meanwhile. It may be renamed.
        name: of the one folder in the zip that everything lies in.

    Attributes:
        length: how many bytes there will be.

    Raises:
        OutputError: the folder cannot be read.
    """

    def __init__(self, folder: Path, name: str) -> None:
        self._folder = folder
        try:
            self._members = tuple(_members(str(folder), name))
        except OSError as error:
            raise OutputError(str(folder), reason(error), _HINT) from error
        self.length = _length(self._members)

    def __iter__(self) -> Generator[bytes]:
        """The bytes, a quarter of a megabyte at a time.

        Raises:
            OutputError: a file cannot be read, or is not what it was.
        """
        sink = _Sink()
        with (
            _opener(self._folder) as open_file,
            zipfile.ZipFile(sink, "w", zipfile.ZIP_STORED) as archive,
        ):
            for member in self._members:
                yield from _sent(archive, member, sink, open_file)
        yield sink.taken()


class _Sink(io.RawIOBase):
    """Takes what is written until it is asked for; it cannot seek, so the zip is written straight on."""

    def __init__(self) -> None:
        self._parts = bytearray()

    def writable(self) -> bool:
        return True

    def write(self, data: "bytes | bytearray | memoryview", /) -> int:  # type: ignore[override]
        self._parts += data
        return len(data)

    def __len__(self) -> int:
        return len(self._parts)

    def taken(self) -> bytes:
        data = bytes(self._parts)
        self._parts.clear()
        return data


@contextmanager
def _opener(folder: Path) -> Iterator[_Open]:
    """Opens files of the folder; also after it was renamed, where the system can hold on to a folder."""
    if os.open not in os.supports_dir_fd:
        yield lambda path: (folder / path).open("rb")
        return
    try:
        held = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    except OSError as error:
        raise OutputError(str(folder), reason(error), _HINT) from error
    try:
        yield lambda path: os.fdopen(os.open(path, os.O_RDONLY | os.O_NOFOLLOW, dir_fd=held), "rb")
    finally:
        os.close(held)


def _sent(archive: zipfile.ZipFile, member: _Member, sink: _Sink, open_file: _Open) -> Iterator[bytes]:
    modified = time.localtime(member.modified_s)[:6]
    info = zipfile.ZipInfo(member.name, min(max(_EARLIEST, modified), _LATEST))
    info.file_size = member.size
    info.external_attr = 0o644 << 16
    try:
        with open_file(member.path) as file, archive.open(info, "w") as entry:
            left = member.size
            while left:
                data = file.read(min(left, _CHUNK_BYTES))
                if not data:
                    raise OutputError(member.name, "became shorter while it was read", _HINT)
                left -= len(data)
                entry.write(data)
                if len(sink) >= _CHUNK_BYTES:
                    yield sink.taken()
    except OSError as error:
        raise OutputError(member.name, reason(error), _HINT) from error


def _members(folder: str, inside: str, below: str = "") -> Iterator[_Member]:
    """Every file, by name."""
    with os.scandir(folder) as entries:
        for entry in sorted(entries, key=lambda entry: entry.name):
            name = f"{inside}/{entry.name}"
            if entry.name.startswith("."):
                continue
            if entry.is_dir(follow_symlinks=False):
                yield from _members(entry.path, name, f"{below}{entry.name}/")
            elif entry.is_file(follow_symlinks=False):
                facts = entry.stat(follow_symlinks=False)
                # A name that is no Unicode, as some systems allow, has no place in a zip.
                text = name.encode("utf-8", "replace").decode()
                yield _Member(below + entry.name, text, facts.st_size, facts.st_mtime)


def _length(members: tuple[_Member, ...]) -> int:
    """Bytes of the zip file, as the standard library writes it to something that cannot seek."""
    limit = zipfile.ZIP64_LIMIT
    offset = central = 0
    for member in members:
        name = len(member.name.encode())
        wide = 8 * (2 * (member.size > limit) + (offset > limit))
        central += _CENTRAL + name + (4 + wide if wide else 0)
        is_long = member.size * 1.05 > limit
        offset += _LOCAL + name + member.size
        offset += _LOCAL_64 + _DESCRIPTOR_64 if is_long else _DESCRIPTOR
    is_large = len(members) > zipfile.ZIP_FILECOUNT_LIMIT or offset > limit or central > limit
    return offset + central + _END + (_END_64 if is_large else 0)
