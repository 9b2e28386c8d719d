"""Live pictures: MJPEG for any browser, a WebSocket for the page."""

import math
from collections.abc import AsyncIterator
from dataclasses import asdict
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, WebSocket
from pydantic import BaseModel, Field

from app.api.nudge import Nudge
from app.api.patience import PatientResponse, sent, until_one_ends
from app.api.services import Served
from app.live.pictures import LivePictures
from app.live.settings import Kind
from app.live.viewer import LiveViewer
from app.scanning.region import Region
from app.vision.stripe import STRIPE_DETECTORS, usual_threshold

router = APIRouter(prefix="/live", tags=["live"])
_BOUNDARY = "turnscan"
_TICK_S = 1.0
_STREAM: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "JPEG after JPEG.",
        "content": {"multipart/x-mixed-replace": {"schema": {"type": "string", "format": "binary"}}},
    }
}
Width = Annotated[int | None, Query(ge=16, le=8192)]


Share = Annotated[float, Field(ge=0.0, le=1.0)]
Height = Annotated[float, Field(ge=-1e4, le=1e4)]


class Cylinder(BaseModel):
    """What of the space above the table is scanned; what is absent has no limit."""

    radius_mm: Annotated[float, Field(gt=0.0, le=1e4)] | None = None
    lowest_mm: Height | None = None
    highest_mm: Height | None = None


class LiveIn(BaseModel):
    """Settings to change; what is absent stays. `threshold` 0 is the detector's own, empty text is none.

    Attributes:
        width: of pictures for viewers that ask for none; 0 for half the camera's.
        line_step: the stripe is looked for on every so-manieth line.
        polygon: corners of the part of the picture that counts, as shares of width and height; none for all.
        cylinder: the limits that are shown where there is a calibration; null for those of a usual scan.
    """

    detector: Annotated[str, Field(max_length=100)] | None = None
    threshold: Annotated[float, Field(ge=0.0, le=255.0)] | None = None
    channel: Annotated[str, Field(max_length=20)] | None = None
    laser: Annotated[str, Field(max_length=200)] | None = None
    quality: Annotated[int, Field(ge=1, le=100)] | None = None
    width: Annotated[int, Field(ge=0, le=8192)] | None = None
    line_step: Annotated[int, Field(ge=1, le=8)] | None = None
    shows_board: bool | None = None
    shows_markers: bool | None = None
    shows_region: bool | None = None
    polygon: Annotated[list[tuple[Share, Share]], Field(max_length=64)] | None = None
    cylinder: Cylinder | None = None


class LiveOut(BaseModel):
    """Settings of all live pictures; see `LiveSettings`."""

    detector: str
    threshold: float | None
    channel: str | None
    laser: str | None
    quality: int
    width: int | None
    line_step: int
    shows_board: bool
    shows_markers: bool
    shows_region: bool
    polygon: list[tuple[float, float]]
    cylinder: Cylinder | None


class DetectorOut(BaseModel):
    """A way of finding the stripe.

    Attributes:
        threshold: below how many grey levels it takes a peak for noise by itself; null where it takes none.
    """

    name: str
    threshold: float | None


@router.get("/detectors")
def list_detectors() -> list[DetectorOut]:
    """The ways of finding the stripe, for live pictures, scans and clouds that are computed again."""
    return [DetectorOut(name=name, threshold=usual_threshold(name)) for name in STRIPE_DETECTORS]


@router.get("/settings")
def show_settings(served: Served) -> LiveOut:
    """As they are."""
    return _shown(served.live)


@router.patch("/settings")
def change_settings(served: Served, wanted: LiveIn) -> LiveOut:
    """Change threshold, channel, detector or what is shown, from the next picture on."""
    given = {name: getattr(wanted, name) for name in wanted.model_fields_set - {"cylinder"}}
    changes = {name: value if value != "" else None for name, value in given.items() if value is not None}
    for name in ("threshold", "width"):
        if changes.get(name) == 0:
            changes[name] = None
    region = None if wanted.cylinder is None else _region(wanted.cylinder)
    served.live.change(**changes)
    if "cylinder" in wanted.model_fields_set:
        served.live.learn(region=region)
    return _shown(served.live)


@router.get("/{kind}.mjpeg", response_class=PatientResponse, responses=_STREAM)
async def stream_pictures(
    request: Request, served: Served, kind: Kind, width: Width = None
) -> PatientResponse:
    """Pictures one after the other, for an `<img>`; the newest wins."""

    async def pictures() -> AsyncIterator[bytes]:
        nudge = Nudge()
        shown = Kind.OVERLAY if kind is Kind.STRIPE else kind
        with served.live.watch(shown, width=width, on_ready=nudge) as viewer:
            viewer.acknowledge()
            while viewer.is_open and not await request.is_disconnected():
                await nudge.wait(_TICK_S)
                picture = viewer.take()
                if picture is None:
                    continue
                head = f"--{_BOUNDARY}\r\nContent-Type: {picture.media_type}\r\n"
                yield f"{head}Content-Length: {len(picture.data)}\r\n\r\n".encode() + picture.data + b"\r\n"
                viewer.acknowledge()

    media_type = f"multipart/x-mixed-replace; boundary={_BOUNDARY}"
    return PatientResponse(pictures(), media_type=media_type, headers={"Cache-Control": "no-store"})


@router.websocket("/{kind}")
async def socket_pictures(
    socket: WebSocket,
    served: Served,
    kind: Kind,
    width: Width = None,
    packed: bool = False,
    captions: bool = True,
) -> None:
    """The newest picture whenever the client asks, which it does by any message, once it has shown the last.

    What it asks while a picture is on its way counts once. Without captions no words are written into it.
    """
    await socket.accept()
    nudge = Nudge()
    is_packed = packed and kind is Kind.MASK
    watching = served.live.watch(
        kind, width=width, is_packed=is_packed, is_captioned=captions, on_ready=nudge
    )
    with watching as viewer:
        await until_one_ends(_ask(socket, viewer), _show(socket, viewer, nudge))


async def _ask(socket: WebSocket, viewer: LiveViewer) -> None:
    while True:
        if (await socket.receive())["type"] == "websocket.disconnect":
            return
        viewer.acknowledge()


async def _show(socket: WebSocket, viewer: LiveViewer, nudge: Nudge) -> None:
    while viewer.is_open:
        await nudge.wait(_TICK_S)
        picture = viewer.take()
        if picture is not None:
            await sent(socket.send_bytes(picture.message()))


def _region(cylinder: Cylinder) -> Region:
    limits = cylinder.model_dump(exclude_none=True)
    return Region(**limits)


def _shown(live: LivePictures) -> LiveOut:
    region = live.known.region
    cylinder = None
    if region is not None:
        limits = {name: getattr(region, name) for name in Cylinder.model_fields}
        cylinder = Cylinder(**{name: value for name, value in limits.items() if math.isfinite(value)})
    return LiveOut.model_validate(asdict(live.settings) | {"cylinder": cylinder})
