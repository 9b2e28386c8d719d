"""Live pictures: MJPEG for any browser, a WebSocket for the page."""

from collections.abc import AsyncIterator
from typing import Annotated

from fastapi import APIRouter, Query, Request, WebSocket
from pydantic import BaseModel, Field

from app.api.nudge import Nudge
from app.api.patience import PatientResponse, sent, until_one_ends
from app.api.services import Served
from app.live.settings import Kind, LiveSettings
from app.live.viewer import LiveViewer

router = APIRouter(prefix="/live", tags=["live"])
_BOUNDARY = "turnscan"
_TICK_S = 1.0
Width = Annotated[int | None, Query(ge=16, le=8192)]


class LiveIn(BaseModel):
    """Settings to change; what is absent stays. `threshold` 0 is the detector's own, empty text is none."""

    detector: Annotated[str, Field(max_length=100)] | None = None
    threshold: Annotated[float, Field(ge=0.0, le=255.0)] | None = None
    channel: Annotated[str, Field(max_length=20)] | None = None
    laser: Annotated[str, Field(max_length=200)] | None = None
    quality: Annotated[int, Field(ge=1, le=100)] | None = None


class LiveOut(BaseModel):
    """Settings of all live pictures; see `LiveSettings`."""

    detector: str
    threshold: float | None
    channel: str | None
    laser: str | None
    quality: int


@router.get("/settings")
def show_settings(served: Served) -> LiveOut:
    """As they are."""
    return _shown(served.live.settings)


@router.patch("/settings")
def change_settings(served: Served, wanted: LiveIn) -> LiveOut:
    """Change threshold, channel or detector, from the next picture on."""
    changes = {name: value if value != "" else None for name, value in wanted if value is not None}
    if changes.get("threshold") == 0.0:
        changes["threshold"] = None
    return _shown(served.live.change(**changes))


@router.get("/{kind}.mjpeg", response_class=PatientResponse)
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
    socket: WebSocket, served: Served, kind: Kind, width: Width = None, packed: bool = False
) -> None:
    """The newest picture whenever the client asks, which it does by any message, once it has shown the last.

    What it asks while a picture is on its way counts once.
    """
    await socket.accept()
    nudge = Nudge()
    is_packed = packed and kind is Kind.MASK
    with served.live.watch(kind, width=width, is_packed=is_packed, on_ready=nudge) as viewer:
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


def _shown(settings: LiveSettings) -> LiveOut:
    return LiveOut(
        detector=settings.detector, threshold=settings.threshold, channel=settings.channel,
        laser=settings.laser, quality=settings.quality,
    )  # fmt: skip
