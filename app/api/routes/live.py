"""Live pictures: MJPEG for any browser, a WebSocket for the page."""

import asyncio
from collections.abc import AsyncIterator
from typing import Annotated

from fastapi import APIRouter, Query, Request, WebSocket, WebSocketDisconnect
from fastapi.responses import StreamingResponse
from pydantic import BaseModel, Field

from app.api.services import Served
from app.live.settings import Kind, LiveSettings

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


@router.get("/{kind}.mjpeg", response_class=StreamingResponse)
def stream_pictures(request: Request, served: Served, kind: Kind, width: Width = None) -> StreamingResponse:
    """Pictures one after the other, for an `<img>`; the newest wins."""

    async def pictures() -> AsyncIterator[bytes]:
        with served.live.watch(Kind.OVERLAY if kind is Kind.STRIPE else kind, width=width) as viewer:
            while viewer.is_open and not await request.is_disconnected():
                picture = await asyncio.to_thread(viewer.next, _TICK_S)
                if picture is not None:
                    head = f"--{_BOUNDARY}\r\nContent-Type: {picture.media_type}\r\n"
                    yield (
                        f"{head}Content-Length: {len(picture.data)}\r\n\r\n".encode() + picture.data + b"\r\n"
                    )

    media_type = f"multipart/x-mixed-replace; boundary={_BOUNDARY}"
    return StreamingResponse(pictures(), media_type=media_type, headers={"Cache-Control": "no-store"})


@router.websocket("/{kind}")
async def socket_pictures(
    socket: WebSocket, served: Served, kind: Kind, width: Width = None, packed: bool = False
) -> None:
    """One picture for each message that the client sends: it asks when it has shown the last one."""
    await socket.accept()
    with served.live.watch(kind, width=width, is_packed=packed and kind is Kind.MASK) as viewer:
        try:
            while viewer.is_open:
                await socket.receive_text()
                picture = None
                while picture is None and viewer.is_open:
                    picture = await asyncio.to_thread(viewer.next, _TICK_S)
                if picture is not None:
                    await socket.send_bytes(picture.message())
        except (WebSocketDisconnect, RuntimeError):
            return


def _shown(settings: LiveSettings) -> LiveOut:
    return LiveOut(
        detector=settings.detector, threshold=settings.threshold, channel=settings.channel,
        laser=settings.laser, quality=settings.quality,
    )  # fmt: skip
