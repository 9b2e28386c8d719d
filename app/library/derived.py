"""Clouds that are made of other clouds: kept beside them, or as a scan of their own."""

import json
from datetime import UTC, datetime
from pathlib import Path

from app.documents import Json
from app.errors import OutputError
from app.files import make_folder, reason, write_whole
from app.geometry.cloud import PointCloud
from app.library.about import write_about
from app.library.item import CLOUDS_FOLDER, CloudItem, ScanItem
from app.library.library import Library
from app.library.log import write_line
from app.library.names import checked_title, free_name
from app.library.work import changing, settle, work_folder
from app.surface.ply import write_ply
from app.surface.preview import PreviewPainter


def keep_cloud(library: Library, name: str, cloud: PointCloud, how: Json, words: str) -> CloudItem:
    """Add a cloud to a scan; those it has stay.

    Args:
        library, name: the scan.
        cloud: to be kept.
        how: it was made; lies beside it. `made_by` in it names what made it.
        words: for the scan's log.

    Raises:
        ScanNotFound: there is no such scan any more.
        OutputError: it cannot be written.
    """
    with work_folder(library.folder) as work:
        created = _write(work, cloud, how)
        settle()
        file = put_files(library, name, work, created)
        write_line(library.folder_of(name), words)
    return library.cloud(name, file)


def new_scan(library: Library, title: str, cloud: PointCloud, how: Json, words: str) -> ScanItem:
    """A scan that has no pictures, only this cloud. Arguments and errors as of `keep_cloud`."""
    title = checked_title(title)
    with work_folder(library.folder) as work:
        scan = work / "scan"
        make_folder(scan / CLOUDS_FOLDER)
        created = _write(work, cloud, how)
        for ending in (".json", ".png", ".ply"):
            (work / f"cloud{ending}").replace(scan / CLOUDS_FOLDER / f"{_stamp(created)}{ending}")
        write_about(scan, created=created, title=title)
        write_line(scan, words)
        return library.place(scan, title)


def put_files(library: Library, name: str, work: Path, created: datetime) -> str:
    """Rename the three files into place; the cloud is there when the last of them, the PLY, is."""
    with changing(library.folder):
        clouds = library.scan(name).folder / CLOUDS_FOLDER
        make_folder(clouds)
        file = free_name(clouds, _stamp(created), ".ply")
        try:
            for ending in (".json", ".png", ".ply"):
                (work / f"cloud{ending}").replace((clouds / file).with_suffix(ending))
        except OSError as error:
            raise OutputError(str(clouds / file), reason(error)) from error
    return f"{CLOUDS_FOLDER}/{file}"


def _write(work: Path, cloud: PointCloud, how: Json) -> datetime:
    """`cloud.ply`, its picture and how it was made, in a work folder."""
    created = datetime.now(UTC)
    write_ply(work / "cloud.ply", cloud)
    painter = PreviewPainter()
    painter.add(cloud)
    painter.write(work / "cloud.png")
    document = {"format": "turnscan-cloud", "version": 1, "created": created.isoformat(), **how}
    text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False)
    write_whole(work / "cloud.json", text.encode() + b"\n")
    return created


def _stamp(created: datetime) -> str:
    return f"{created:%Y-%m-%dT%H-%M-%S}.{created.microsecond // 1000:03d}Z"
