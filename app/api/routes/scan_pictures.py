"""The pictures of a scan, one by one."""

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response
from pydantic import BaseModel

from app.api.downloads import file_answer, made_answer
from app.api.services import Served
from app.library.pictures import numbered, picture_file, pictures_of, small_picture
from app.recording.shot import Role

router = APIRouter(prefix="/scans", tags=["scans"])
_JPEG = "image/jpeg"
_MEDIA_TYPES = {".png": "image/png", ".jpg": _JPEG, ".jpeg": _JPEG}
Start = Annotated[int, Query(ge=0, le=10_000_000, description="How many to pass over.")]
Count = Annotated[int, Query(ge=1, le=1000, description="How many to list at most.")]
Width = Annotated[int | None, Query(ge=16, le=2048, description="No wider than that, as JPEG.")]


class PictureOut(BaseModel):
    """A picture of a recording.

    Attributes:
        number: names it, from 0.
        angle_deg: of the table; null where nobody knows.
        lasers_on: that were lit.
        pose: number of the board's placement.
        time_s: since the recording began.
    """

    number: int
    role: Role
    angle_deg: float | None
    lasers_on: list[str]
    pose: int | None
    time_s: float | None
    exposure_us: float | None


class PicturesOut(BaseModel):
    """A page of them.

    Attributes:
        total: pictures of the roles that were asked for.
        width, height: of each, pixels.
    """

    total: int
    start: int
    width: int
    height: int
    pictures: list[PictureOut]


@router.get("/{name}/pictures")
def list_pictures(
    served: Served,
    name: str,
    start: Start = 0,
    count: Count = 100,
    role: Annotated[list[Role] | None, Query(description="Of these roles alone.")] = None,
) -> PicturesOut:
    """The pictures of its recording in the order they were taken."""
    recording = pictures_of(served.library.folder_of(name))
    wanted = numbered(recording, role or [])
    width, height = recording.camera_size
    shown = [
        PictureOut(
            number=number, role=entry.role, angle_deg=recording.angle_deg(entry),
            lasers_on=list(entry.lasers_on), pose=entry.pose, time_s=entry.time_s,
            exposure_us=entry.exposure_us,
        )
        for number, entry in wanted[start : start + count]
    ]  # fmt: skip
    return PicturesOut(total=len(wanted), start=start, width=width, height=height, pictures=shown)


@router.head("/{name}/pictures/{number}", include_in_schema=False)
@router.get(
    "/{name}/pictures/{number}",
    response_class=Response,
    responses={200: {"content": {_JPEG: {}, "image/png": {}}}},
)
def show_picture(request: Request, served: Served, name: str, number: int, width: Width = None) -> Response:
    """One picture as the camera gave it, or a smaller one."""
    recording = pictures_of(served.library.folder_of(name))
    path = picture_file(recording, number)
    if width is None:
        return file_answer(request, path, _MEDIA_TYPES.get(path.suffix.lower(), "application/octet-stream"))
    return made_answer(request, path, lambda: small_picture(recording, number, width), _JPEG, width)
