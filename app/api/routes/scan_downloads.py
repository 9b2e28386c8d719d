"""Clouds, recordings and documents of a scan, as files."""

from typing import Annotated, Literal

from fastapi import APIRouter, Query, Request, Response

from app.api.downloads import PartsResponse, attachment, file_answer, made_answer
from app.api.services import Served, Services
from app.errors import NotThere
from app.library.cloud_form import CloudForm, cloud_in_form
from app.library.item import CloudItem
from app.library.pictures import middle_picture, picture_file, pictures_of, small_picture
from app.library.thumbnail import SIDE_PX

router = APIRouter(prefix="/scans", tags=["scans"])
_PLY, _ZIP, _PNG, _JSON = "application/octet-stream", "application/zip", "image/png", "application/json"
Form = Annotated[
    CloudForm | None, Query(description="Numbers as bytes or as text; as it is kept, where absent.")
]
Document = Literal["scan", "calibration", "recording", "about"]


@router.head("/{name}/cloud.ply", include_in_schema=False)
@router.get("/{name}/cloud.ply", response_class=Response, responses={200: {"content": {_PLY: {}}}})
def download_newest_cloud(request: Request, served: Served, name: str, form: Form = None) -> Response:
    """Its newest cloud."""
    item = served.library.scan(name)
    if not item.clouds:
        raise NotThere(f"The scan {item.title!r} has no cloud.", "Reconstruct it first.")
    return _sent(request, served, name, item.clouds[-1], form)


@router.head("/{name}/clouds/{cloud:path}", include_in_schema=False)
@router.get("/{name}/clouds/{cloud:path}", response_class=Response, responses={200: {"content": {_PLY: {}}}})
def download_cloud(request: Request, served: Served, name: str, cloud: str, form: Form = None) -> Response:
    """One of its clouds, by its name without `clouds/`. As it is kept, it can be asked for in parts."""
    return _sent(request, served, name, served.library.cloud(name, cloud), form)


@router.get("/{name}/made/{cloud:path}", response_class=Response, responses={200: {"content": {_JSON: {}}}})
def show_how_cloud_was_made(request: Request, served: Served, name: str, cloud: str) -> Response:
    """Detector, options and calibration of a cloud, where they are known."""
    found = served.library.cloud(name, cloud)
    path = (served.library.folder_of(name) / found.name).with_suffix(".json")
    if "/" not in found.name or not path.is_file() or path.is_symlink():
        raise NotThere(f"Nobody wrote down how {found.name} was made.", "Reconstruct the scan again.")
    return file_answer(request, path, _JSON)


@router.head("/{name}/thumbnail.png", include_in_schema=False)
@router.get("/{name}/thumbnail.png", response_class=Response, responses={200: {"content": {_PNG: {}}}})
def show_thumbnail(request: Request, served: Served, name: str) -> Response:
    """A picture of its newest cloud; without a cloud, the middle one of its pictures."""
    path = served.library.scan(name).thumbnail
    if path is not None and path.is_file() and not path.is_symlink():
        return file_answer(request, path, _PNG)
    recording = pictures_of(served.library.folder_of(name))
    number = middle_picture(recording)
    source = picture_file(recording, number)
    return made_answer(
        request, source, lambda: small_picture(recording, number, SIDE_PX, "png"), _PNG, SIDE_PX
    )


@router.head("/{name}/recording.zip", include_in_schema=False)
@router.get("/{name}/recording.zip", response_class=Response, responses={200: {"content": {_ZIP: {}}}})
def download_recording(served: Served, name: str) -> Response:
    """The whole folder as a zip file, made as it is sent."""
    stream = served.library.export(name)
    headers = {
        "Content-Disposition": attachment(served.library.scan(name).title, ".zip"),
        "Cache-Control": "no-store",
    }
    return PartsResponse(iter(stream), _ZIP, headers, stream.length)


@router.head("/{name}/{document}.json", include_in_schema=False)
@router.get("/{name}/{document}.json", response_class=Response, responses={200: {"content": {_JSON: {}}}})
def show_document(request: Request, served: Served, name: str, document: Document) -> Response:
    """A file of the scan: what it was to do, the calibration it was taken with, the list of its pictures."""
    path = served.library.folder_of(name) / f"{document}.json"
    if path.is_symlink() or not path.is_file():
        raise NotThere(f"The scan {name!r} has no {document}.json.", "Ask for the scan: it says what it is.")
    return file_answer(request, path, _JSON)


def _sent(
    request: Request, served: Services, name: str, cloud: CloudItem, form: CloudForm | None
) -> Response:
    item = served.library.scan(name)
    path = item.folder / cloud.name
    named = attachment(item.title, ".ply")
    parts = None if form is None else cloud_in_form(path, form)
    if parts is None:
        return file_answer(request, path, _PLY, named)
    return PartsResponse(parts, _PLY, {"Content-Disposition": named, "Cache-Control": "no-store"})
