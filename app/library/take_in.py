"""Scans from elsewhere: folders, zip files, PLY files; checked in a work folder, then renamed into place."""

import os
import shutil
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

from app.documents import read_document
from app.errors import LibraryError, PointCloudFileError, RecordingError, ScanBusy
from app.files import reason
from app.library.about import ABOUT_FILE, read_about, write_about
from app.library.item import (
    CALIBRATION_FILE,
    CLOUDS_FOLDER,
    SCAN_FILE,
    ScanItem,
    holds_scan,
    is_busy,
    is_cloud,
    read_item,
)
from app.library.library import Library
from app.library.limits import (
    Limits,
    Progress,
    check_amount,
    check_name,
    check_room,
    in_words,
    is_wanted,
    refused,
)
from app.library.log import LOG_FILE, write_line
from app.library.names import checked_title, slug
from app.library.unpack import unpack
from app.library.work import work_folder
from app.recording.journal import JOURNAL_FILE, MANIFEST_FILE
from app.recording.reader import Recording
from app.scanning.session import ScanFile
from app.surface.ply_reader import PlyFile
from app.surface.preview import PreviewPainter

_MAGIC_BYTES = 4
_LONGEST_TITLE = 200


def take_in(
    library: Library,
    source: Path,
    title: str = "",
    *,
    name: str = "",
    limits: Limits | None = None,
    progress: Progress = lambda done, total: None,
) -> ScanItem:
    """Copy a scan into the library; nothing of it is to be trusted, and nothing half taken in stays.

    Args:
        library: where to.
        source: the folder of a scan or of any recording; a zip file of one; a PLY file.
        title: by default the one it has, or the name of the source.
        name: what the source is called in messages, where its path means nothing to the person.
        limits: what is too much.
        progress: told how it goes.

    Raises:
        ImportFailed: it is none of these, damaged, or holds what it should not.
        ScanBusy: the scan is still being taken.
        LibraryError: the title cannot be used.
        OutputError: there is no room, or it cannot be written.
    """
    called, limits = name or source.name, limits or Limits()
    wanted_title = checked_title(title) if title else ""
    with work_folder(library.folder) as work:
        scan = work / "scan"
        scan.mkdir()
        _fetch(source, called, scan, limits, progress)
        found = _located(scan, called)
        try:
            _check(found, limits)
            given = read_about(found)
        except (RecordingError, PointCloudFileError, LibraryError) as error:
            told = error.message.replace(f"{found}{os.sep}", "").replace(str(found), "the scan")
            raise refused(called, told, "Mend it, or import what it was made from.") from error
        final = wanted_title or given.title or _title_of(called)
        write_about(found, created=read_item(found).created, title=final)
        write_line(found, f"Taken in from {called}.")
        return library.place(found, final)


def _fetch(source: Path, called: str, to: Path, limits: Limits, progress: Progress) -> None:
    if source.is_dir():
        _copy_folder(source, called, to, limits, progress)
        return
    try:
        with source.open("rb") as file:
            magic = file.read(_MAGIC_BYTES)
    except OSError as error:
        raise refused(called, reason(error)) from error
    if magic[:2] == b"PK":
        unpack(source, called, to, limits, progress)
    elif magic[:3] == b"ply":
        size = source.stat().st_size
        check_room(to, size)
        (to / CLOUDS_FOLDER).mkdir()
        shutil.copyfile(source, to / CLOUDS_FOLDER / f"{slug(Path(called).stem)}.ply")
        progress(size, size)
    else:
        raise refused(called, "is neither a folder nor a zip file nor a PLY file")


def _copy_folder(source: Path, called: str, to: Path, limits: Limits, progress: Progress) -> None:
    if not holds_scan(source):
        raise refused(called, "holds no recording and no cloud")
    if is_busy(source):
        raise ScanBusy(f"{called}: the scan is being taken.")
    files = list(_files(source, called, PurePosixPath(), limits))
    total = sum(size for _, size in files)
    check_amount(called, len(files), total, limits)
    check_room(to, total)
    done = 0
    for path, size in files:
        target = to / path
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source / path, target, follow_symlinks=False)
        shutil.copystat(source / path, target, follow_symlinks=False)
        done += size
        progress(done, total)


def _files(
    folder: Path, called: str, inside: PurePosixPath, limits: Limits
) -> Iterator[tuple[PurePosixPath, int]]:
    """Every file that belongs to the scan, and its size."""
    with os.scandir(folder) as entries:
        for entry in entries:
            path = inside / entry.name
            if not is_wanted(path):
                continue
            check_name(called, str(path))
            if entry.is_dir(follow_symlinks=False):
                yield from _files(folder / entry.name, called, path, limits)
            elif entry.is_file(follow_symlinks=False):
                yield path, entry.stat(follow_symlinks=False).st_size
            else:
                raise refused(called, f"holds something that is no file: {path}")


def _located(folder: Path, called: str) -> Path:
    """The scan in what was unpacked: at the top, or in the one folder that there is."""
    while not holds_scan(folder):
        below = [path for path in folder.iterdir() if path.is_dir()]
        scans = [path for path in below if holds_scan(path)]
        if len(scans) > 1:
            raise refused(called, f"holds {len(scans)} scans", "Import them one by one.")
        if not scans and len(below) != 1:
            raise refused(called, "holds no recording and no cloud")
        folder = (scans or below)[0]
    return folder


def _check(scan: Path, limits: Limits) -> None:
    """Whether everything in it can be read; clouds get their pictures on the way."""
    for name in (ABOUT_FILE, LOG_FILE, SCAN_FILE, MANIFEST_FILE, JOURNAL_FILE, CALIBRATION_FILE):
        if (scan / name).is_dir():
            raise RecordingError(str(scan / name), "is a folder")
    if any((scan / name).exists() for name in (MANIFEST_FILE, JOURNAL_FILE)):
        Recording.open(scan)
    if (scan / SCAN_FILE).exists():
        read_document(scan / SCAN_FILE, ScanFile, RecordingError)
    for place in (scan, scan / CLOUDS_FOLDER):
        for path in sorted(place.glob("*")):
            if is_cloud(path.name):
                _check_cloud(path, limits)


def _check_cloud(path: Path, limits: Limits) -> None:
    if path.stat().st_size > limits.cloud_bytes:
        raise PointCloudFileError(str(path), f"is larger than {in_words(limits.cloud_bytes)}")
    painter = PreviewPainter()
    for piece in PlyFile.open(path).pieces(allows_nowhere=True):
        painter.add(piece)
    if not path.with_suffix(".png").exists():
        painter.write(path.with_suffix(".png"))


def _title_of(called: str) -> str:
    """A title made of the name of a file."""
    text = "".join(letter for letter in Path(called).stem if letter.isprintable())
    return " ".join(text.split())[:_LONGEST_TITLE] or "scan"
