"""Scans of the library as they go out over HTTP."""

from datetime import datetime
from urllib.parse import quote

from pydantic import BaseModel

from app.api.versioned import API
from app.library.item import CLOUDS_FOLDER, CloudItem, ScanItem


class CloudOut(BaseModel):
    """A cloud of a scan; see `CloudItem`.

    Attributes:
        path: where to download it, on this server.
        made_by: `joined` of several scans, `cleaned` of another cloud; empty for what was scanned.
    """

    name: str
    path: str
    points: int
    size_bytes: int
    created: datetime
    detector: str
    calibrated: datetime | None
    made_by: str


class CalibrationOut(BaseModel):
    """The calibration a scan was taken with."""

    created: datetime
    method: str
    expected_error_mm: float | None


class ScanOut(BaseModel):
    """A scan; see `ScanItem`.

    Attributes:
        size_bytes: of everything in its folder; `recording.zip` is a little larger.
        points: of the newest cloud.
        clouds: oldest first.
    """

    name: str
    title: str
    note: str
    created: datetime
    status: str
    reason: str
    pictures: int
    points: int
    size_bytes: int
    clouds: list[CloudOut]
    calibration: CalibrationOut | None
    has_thumbnail: bool


def shown_scan(item: ScanItem) -> ScanOut:
    """A scan as it goes out."""
    note = item.calibration
    return ScanOut(
        name=item.name, title=item.title, note=item.note, created=item.created, status=item.status,
        reason=item.reason, pictures=item.pictures, points=item.points, size_bytes=item.size_bytes,
        clouds=[_shown_cloud(item, cloud) for cloud in item.clouds],
        calibration=None if note is None else CalibrationOut(
            created=note.created, method=note.method, expected_error_mm=note.expected_error_mm,
        ),
        has_thumbnail=item.thumbnail is not None or item.pictures > 0,
    )  # fmt: skip


def _shown_cloud(item: ScanItem, cloud: CloudItem) -> CloudOut:
    short = cloud.name.removeprefix(f"{CLOUDS_FOLDER}/")
    is_clear = short == cloud.name or all(other.name != short for other in item.clouds)
    place = quote(short if is_clear else cloud.name)
    return CloudOut(
        name=cloud.name, path=f"{API}/scans/{quote(item.name, safe='')}/clouds/{place}", points=cloud.points,
        size_bytes=cloud.size_bytes, created=cloud.created, detector=cloud.detector,
        calibrated=cloud.calibrated, made_by=cloud.made_by,
    )  # fmt: skip
