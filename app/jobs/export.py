"""The export job: a cloud in the form that another program wants, into the scan's own folder."""

from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from app.errors import NotThere
from app.files import make_folder, replacing
from app.geometry.cloud import PointCloud
from app.jobs.clouds import cloud_of
from app.jobs.runner import JobContext, Work
from app.library.library import Library
from app.surface.ply import PlyWriter
from app.surface.ply_reader import read_ply

EXPORTS_FOLDER = "exports"
_CHUNK = 50_000


class ExportForm(StrEnum):
    """What a cloud can be written as."""

    PLY = "ply"
    PLY_ASCII = "ply-ascii"
    XYZ = "xyz"


def export_work(library: Library, name: str, form: ExportForm, cloud: str = "") -> Work:
    """Write a cloud of a scan in another form; a file of the same name is replaced.

    Args:
        library, name: the scan.
        form: see there. XYZ is text: x y z in mm, red green blue, a point in each line.
        cloud: which one; the newest where none is named.
    """

    def work(job: JobContext) -> Mapping[str, Any]:
        item = library.scan(name)
        source = cloud_of(item, cloud)
        points = read_ply(source)
        folder = item.folder / EXPORTS_FOLDER
        make_folder(folder)
        path = (
            folder / f"{source.stem}{'.ascii' if form is ExportForm.PLY_ASCII else ''}.{form.split('-')[0]}"
        )
        _write(job, path, points, form)
        return {
            "file": f"{EXPORTS_FOLDER}/{path.name}", "points": len(points), "size_bytes": path.stat().st_size,
        }  # fmt: skip

    return work


def exported(library: Library, name: str, file: object) -> Path:
    """Where the file lies that an export job made.

    Raises:
        NotThere: it made none, or it has gone.
    """
    if isinstance(file, str):
        folder, _, last = file.partition("/")
        path = library.scan(name).folder / EXPORTS_FOLDER / last
        if folder == EXPORTS_FOLDER and path.name == last and path.is_file() and not path.is_symlink():
            return path
    raise NotThere("The job has no file to download.", "Only an export that is done has one.")


def _write(job: JobContext, path: Path, cloud: PointCloud, form: ExportForm) -> None:
    parts = [np.arange(first, min(first + _CHUNK, len(cloud))) for first in range(0, len(cloud), _CHUNK)]
    if form is ExportForm.XYZ:
        with replacing(path, is_durable=False) as file:
            for number, which in enumerate(parts, start=1):
                file.write(_lines(cloud.select(which)))
                _tell(job, number, len(parts))
        return
    with PlyWriter(path, cloud.laser_names, ascii_text=form is ExportForm.PLY_ASCII) as ply:
        for number, which in enumerate(parts, start=1):
            ply.append(cloud.select(which))
            _tell(job, number, len(parts))


def _tell(job: JobContext, done: int, total: int) -> None:
    job.checkpoint()
    job.progress(done, total, "writing")


def _lines(cloud: PointCloud) -> bytes:
    rows = zip(cloud.points.tolist(), cloud.colours.tolist(), strict=True)
    return "".join(
        f"{x:.4f} {y:.4f} {z:.4f} {red} {green} {blue}\n" for (x, y, z), (red, green, blue) in rows
    ).encode("ascii")
