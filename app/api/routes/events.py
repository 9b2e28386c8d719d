"""News as they happen, over a WebSocket or as server-sent events."""

import contextlib
from collections.abc import AsyncIterator
from typing import Any

from fastapi import APIRouter, Request, WebSocket

from app.api.news_models import AnyEventOut
from app.api.patience import PatientResponse, sent, until_one_ends
from app.api.services import Served
from app.errors import DeviceError

router = APIRouter(prefix="/events", tags=["events"])
_STREAM: dict[int | str, dict[str, Any]] = {
    200: {
        "model": AnyEventOut,
        "content": {"text/event-stream": {"schema": {"type": "string"}}},
        "description": "A stream of events; the data of each is JSON of this form. `state` comes first.",
    }
}
_STOP = "stop"


@router.websocket("")
async def socket_events(socket: WebSocket, served: Served) -> None:
    """Every event as one JSON message. A client that sends the text `stop` presses the emergency stop."""
    await socket.accept()
    await until_one_ends(_hear(socket, served), _tell(socket, served))


@router.get("/stream", response_class=PatientResponse, responses=_STREAM)
async def stream_events(request: Request, served: Served) -> PatientResponse:
    """The same as server-sent events; their ids grow."""

    async def events() -> AsyncIterator[str]:
        async with contextlib.aclosing(served.desk.listen()) as news:
            async for batch in news:
                if await request.is_disconnected():
                    return
                yield (
                    "".join(f"id: {number}\ndata: {text}\n\n" for number, text in batch) or ": still here\n\n"
                )

    headers = {"Cache-Control": "no-store"}
    return PatientResponse(events(), media_type="text/event-stream", headers=headers)


async def _tell(socket: WebSocket, served: Served) -> None:
    async with contextlib.aclosing(served.desk.listen()) as news:
        async for batch in news:
            for _, text in batch:
                await sent(socket.send_text(text))


async def _hear(socket: WebSocket, served: Served) -> None:
    while True:
        if (await socket.receive_text()).strip() == _STOP:
            # What comes of it is told by the bench's own events.
            with contextlib.suppress(DeviceError):
                await served.emergency.press()
