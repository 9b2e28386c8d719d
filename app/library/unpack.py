"""Zip files from anywhere, unpacked into a folder of our own; checked before anything is written."""

import os
import stat
import struct
import time
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path, PurePosixPath
from typing import BinaryIO

from app.library.limits import Limits, Progress, check_amount, check_name, check_room, is_wanted, refused

_CHUNK_BYTES = 1 << 20
_DAMAGED = "Make the zip file again, or fetch it again."
# An entry of the table of contents has 46 bytes and its name, an end record 22 and a comment.
_USUAL_ENTRY = 46 + 128
_END, _END_MAGIC = struct.Struct("<4s4H2LH"), b"PK\x05\x06"
_END_64, _END_64_MAGIC = struct.Struct("<4sQ2H2L4Q"), b"PK\x06\x06"
_LOCATOR_BYTES, _LONGEST_COMMENT = 20, 65_535
_KINDS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_ENCRYPTED = 1
# What the standard library raises of a damaged file: a wrong offset is an OSError, too.
_BROKEN = (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, OSError)


def unpack(source: Path, name: str, folder: Path, limits: Limits, progress: Progress) -> None:
    """Unpack a zip file into an empty folder.

    Args:
        source: the file.
        name: what it is called in messages.
        folder: where to.
        limits: what is too much.
        progress: told how it goes.

    Raises:
        ImportFailed: it is damaged, or holds what no scan needs: links, names that lead elsewhere, too much.
        OutputError: there is no room.
        OSError: the disk fails.
    """
    with source.open("rb") as file:
        _check_contents(file, name, limits)
        try:
            archive = zipfile.ZipFile(file)
        except (*_BROKEN, ValueError, struct.error) as error:
            raise refused(name, "is no zip file, or a damaged one", _DAMAGED) from error
        with archive:
            wanted = _checked(archive, name, source.stat().st_size, limits)
            total = sum(info.file_size for info, _ in wanted)
            check_room(folder, total)
            done = 0
            for info, path in wanted:
                done = _unpacked(archive, info, folder / path, name, done, total, progress)


def _check_contents(file: BinaryIO, name: str, limits: Limits) -> None:
    """Whether the table of contents is of a size that may be read into memory."""
    size = file.seek(0, os.SEEK_END)
    start = max(0, size - _LONGEST_COMMENT - _END.size - _LOCATOR_BYTES - _END_64.size)
    file.seek(start)
    tail = file.read()
    place = tail.rfind(_END_MAGIC)
    if place < 0 or place + _END.size > len(tail):
        raise refused(name, "is no zip file, or a damaged one", _DAMAGED)
    length = _END.unpack_from(tail, place)[5]
    wide = place - _LOCATOR_BYTES - _END_64.size
    if wide >= 0 and tail.startswith(_END_64_MAGIC, wide):
        length = _END_64.unpack_from(tail, wide)[8]
    check_amount(name, length // _USUAL_ENTRY, 0, limits)
    file.seek(0)


def _checked(
    archive: zipfile.ZipFile, name: str, archive_bytes: int, limits: Limits
) -> list[tuple[zipfile.ZipInfo, PurePosixPath]]:
    """Files that are wanted, and where they go."""
    infos = archive.infolist()
    total = sum(info.file_size for info in infos)
    check_amount(name, len(infos), total, limits)
    if total > limits.expansion * archive_bytes:
        raise refused(name, f"unpacks to more than {limits.expansion} times its size")
    wanted = []
    files: set[str] = set()
    folders: set[str] = set()
    for info in infos:
        path = check_name(name, info.filename)
        kind = stat.S_IFMT(info.external_attr >> 16)
        if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
            raise refused(name, f"holds something that is no file: {info.filename[:60]!a}")
        if info.is_dir() or not is_wanted(path):
            continue
        if info.flag_bits & _ENCRYPTED:
            raise refused(name, "is encrypted", "Make it again without a password.")
        if info.compress_type not in _KINDS:
            raise refused(name, "is compressed in an unusual way", "Make it again, stored or deflated.")
        # Some systems take large letters for small ones.
        key = str(path).casefold()
        if key in files:
            raise refused(name, f"holds the same file twice: {info.filename[:60]!a}")
        files.add(key)
        folders.update(str(parent).casefold() for parent in path.parents)
        wanted.append((info, path))
    if files & folders:
        raise refused(name, f"holds a file that is a folder, too: {min(files & folders)[:60]!a}")
    return wanted


def _unpacked(
    archive: zipfile.ZipFile,
    info: zipfile.ZipInfo,
    to: Path,
    name: str,
    done: int,
    total: int,
    progress: Progress,
) -> int:
    """Write one file; how many bytes of all are done then."""
    to.parent.mkdir(parents=True, exist_ok=True)
    with to.open("xb") as target:
        for data in _read(archive, info, name):
            target.write(data)
            done += len(data)
            progress(done, total)
    with suppress(ValueError, OverflowError):
        written_s = time.mktime((*info.date_time, 0, 0, -1))
        os.utime(to, (written_s, written_s))
    return done


def _read(archive: zipfile.ZipFile, info: zipfile.ZipInfo, name: str) -> Iterator[bytes]:
    """One file, piece by piece, never more than its entry promises."""
    try:
        with archive.open(info) as packed:
            while data := packed.read(_CHUNK_BYTES):
                yield data
    except _BROKEN as error:
        raise refused(name, f"{info.filename[:60]!a} in it is damaged", _DAMAGED) from error
