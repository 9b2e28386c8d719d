"""Zip files that nobody should make."""

import io
import zipfile
from collections.abc import Mapping
from pathlib import Path

from small_library import make_scan


def parts(folder: Path) -> dict[str, bytes]:
    """The files of a scan, ready for a zip file."""
    scan = make_scan(folder)
    return {
        path.relative_to(scan).as_posix(): path.read_bytes() for path in scan.rglob("*") if path.is_file()
    }


def zipped(path: Path, files: Mapping[str, bytes], kind: int = zipfile.ZIP_STORED) -> Path:
    with zipfile.ZipFile(path, "w", kind) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return path


def with_entry(path: Path, info: zipfile.ZipInfo, data: bytes = b"") -> Path:
    """One more entry, as odd as wanted."""
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(info, data)
    return path


def with_bytes(path: Path, old: bytes, new: bytes) -> Path:
    """Other bytes in place of these, wherever they are."""
    data = path.read_bytes()
    assert old in data
    assert len(old) == len(new)
    path.write_bytes(data.replace(old, new))
    return path


def bytes_of(files: Mapping[str, bytes]) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return buffer.getvalue()
