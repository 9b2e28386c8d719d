"""The library of scans."""

from collections.abc import Iterator
from datetime import datetime
from typing import Annotated

from fastapi import APIRouter, Response
from fastapi.responses import FileResponse, StreamingResponse
from pydantic import BaseModel, Field

from app.api.services import Served
from app.errors import NotThere
from app.library.item import ScanItem

router = APIRouter(prefix="/scans", tags=["scans"])


class CloudOut(BaseModel):
    """A cloud of a scan."""

    name: str
    points: int
    size_bytes: int
    created: datetime


class ScanOut(BaseModel):
    """A scan; see `ScanItem`."""

    name: str
    title: str
    note: str
    created: datetime
    status: str
    reason: str
    pictures: int
    size_bytes: int
    clouds: list[CloudOut]
    has_thumbnail: bool


class Words(BaseModel):
    """What people call a scan and say of it; what is absent stays."""

    title: Annotated[str, Field(min_length=1, max_length=200)] | None = None
    note: Annotated[str, Field(max_length=10_000)] | None = None


class BinOut(BaseModel):
    """Where a deleted scan is, until the bin is emptied."""

    key: str


@router.get("")
def list_scans(served: Served) -> list[ScanOut]:
    """All scans, newest first."""
    return [_shown(item) for item in served.library.scans()]


@router.get("/{name}")
def show_scan(served: Served, name: str) -> ScanOut:
    """One scan."""
    return _shown(served.library.scan(name))


@router.patch("/{name}")
def describe_scan(served: Served, name: str, words: Words) -> ScanOut:
    """Give it another title or note."""
    if words.title is not None:
        served.library.rename(name, words.title)
    if words.note is not None:
        served.library.note(name, words.note)
    return _shown(served.library.scan(name))


@router.delete("/{name}")
def delete_scan(served: Served, name: str) -> BinOut:
    """Move it to the bin."""
    return BinOut(key=served.library.delete(name).key)


@router.post("/bin/{key}/restore")
def restore_scan(served: Served, key: str) -> ScanOut:
    """Take it back from the bin."""
    return _shown(served.library.restore(key))


@router.get("/{name}/cloud.ply", response_class=FileResponse)
def download_cloud(served: Served, name: str) -> FileResponse:
    """Its newest cloud."""
    item = served.library.scan(name)
    if not item.clouds:
        raise NotThere(f"The scan {item.title!r} has no cloud.", "Reconstruct it first.")
    path = item.folder / item.clouds[-1].name
    return FileResponse(path, media_type="application/octet-stream", filename=f"{item.name}.ply")


@router.get("/{name}/thumbnail.png", response_class=FileResponse)
def show_thumbnail(served: Served, name: str) -> FileResponse:
    """A picture of its newest cloud."""
    path = served.library.scan(name).thumbnail
    if path is None or not path.is_file():
        raise NotThere(f"The scan {name!r} has no picture.", "Reconstruct it first.")
    return FileResponse(path, media_type="image/png")


@router.get("/{name}/recording.zip", response_class=StreamingResponse)
def download_recording(served: Served, name: str) -> Response:
    """The whole folder, made as it is sent."""
    stream = served.library.export(name)

    def parts() -> Iterator[bytes]:
        yield from stream

    headers = {
        "Content-Disposition": f'attachment; filename="{name}.zip"', "Content-Length": str(stream.length),
    }  # fmt: skip
    return StreamingResponse(parts(), media_type="application/zip", headers=headers)


def _shown(item: ScanItem) -> ScanOut:
    clouds = [
        CloudOut(name=each.name, points=each.points, size_bytes=each.size_bytes, created=each.created)
        for each in item.clouds
    ]
    return ScanOut(
        name=item.name, title=item.title, note=item.note, created=item.created, status=item.status,
        reason=item.reason, pictures=item.pictures, size_bytes=item.size_bytes, clouds=clouds,
        has_thumbnail=item.thumbnail is not None,
    )  # fmt: skip
