"""The texture job: pictures with the lasers off from all around, then a cloud's colours from them."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from app.calibration.record import CalibrationRecord
from app.devices.bench import Bench
from app.documents import read_document
from app.errors import LibraryError, PositionUnknown, ScannerError
from app.files import make_folder
from app.jobs.clouds import cloud_of
from app.jobs.runner import JobContext, Work
from app.library.item import CLOUDS_FOLDER
from app.library.library import Library
from app.library.names import free_name
from app.recording.reader import Recording
from app.recording.writer import RecordingWriter
from app.scanning.frames import TEXTURE_LOOK
from app.scanning.session import SCAN_FILE, ScanFile
from app.scanning.texture import coloured, take_textures, texture_entries
from app.surface.ply import write_ply
from app.surface.ply_reader import read_ply
from app.surface.preview import PreviewPainter


def texture_work(bench: Bench, library: Library, name: str, record: CalibrationRecord, pictures: int) -> Work:
    """Take so many pictures into the recording of a finished scan, and give its newest cloud their colours.

    The object must stand on the table as it did. The clouds that are there stay.
    """

    def work(job: JobContext) -> Mapping[str, Any]:
        item = library.scan(name)
        library.refuse_busy(name)
        source = cloud_of(item, "")
        bench.connect()
        _take(job, bench, item.folder, pictures)
        recording = Recording.open(item.folder)

        def progress(done: int, total: int) -> None:
            job.checkpoint()
            job.progress(done, total, "colouring")

        cloud = coloured(read_ply(source), record.rig, recording, texture_entries(recording), progress)
        clouds = item.folder / CLOUDS_FOLDER
        make_folder(clouds)
        path = clouds / free_name(clouds, f"{datetime.now(UTC):%Y-%m-%dT%H-%M-%S}Z", ".ply")
        painter = PreviewPainter()
        painter.add(cloud)
        painter.write(path.with_suffix(".png"))
        write_ply(path, cloud)
        return {"cloud": path.relative_to(item.folder).as_posix(), "points": len(cloud), "pictures": pictures}

    return work


def _take(job: JobContext, bench: Bench, folder: Path, pictures: int) -> None:
    round_name = datetime.now(UTC).isoformat(timespec="seconds")
    with bench.lease("a texture job"), _continued(folder) as writer:
        _refuse_turned(bench, folder)
        job.on_cancel(bench.make_safe)
        for number, taken in enumerate(take_textures(bench, pictures, lambda angle_deg: None), start=1):
            writer.append_encoded(
                taken.data, taken.look.role, (), taken.angle_deg, exposure_us=taken.exposure_us,
                extra={"look": TEXTURE_LOOK, "round": round_name},
            )  # fmt: skip
            job.progress(number, pictures, f"picture {number} of {pictures}")
            job.checkpoint()


@contextmanager
def _continued(folder: Path) -> Iterator[RecordingWriter]:
    """The recording, open for more; closed again on every way out, so that what was taken belongs to it."""
    writer = RecordingWriter.resume(folder)
    try:
        yield writer
    except BaseException:
        try:
            writer.close()
        except ScannerError:
            # The journal stays, and is read in place of the manifest.
            writer.suspend()
        raise
    writer.close()


def _refuse_turned(bench: Bench, folder: Path) -> None:
    """Angles mean what they meant in the scan only as long as their zero is the same.

    Raises:
        LibraryError: the folder holds no scan of this program.
        PositionUnknown: the zero is another one by now.
    """
    if not (folder / SCAN_FILE).is_file():
        raise LibraryError(f"{folder.name!r} was not scanned with this program.", "Scan the object again.")
    saved = read_document(folder / SCAN_FILE, ScanFile, _unreadable)
    if saved.zero == bench.zero_name:
        return
    if saved.table.moving_to_deg is not None:
        raise PositionUnknown(
            bench.description.turntable.driver, *sorted((saved.table.angle_deg, saved.table.moving_to_deg))
        )
    # As when a scan is gone on with: the table is taken to stand where the scan left it.
    bench.restore(saved.table.angle_deg)
    bench.zero(saved.table.angle_deg)


def _unreadable(where: str, problem: str) -> LibraryError:
    return LibraryError(f"{where}: {problem}")
