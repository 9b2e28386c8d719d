"""News as they happen, over a WebSocket or as server-sent events."""

import asyncio
import json
from collections.abc import AsyncIterator
from typing import Any

from fastapi import APIRouter, Request, WebSocket, WebSocketDisconnect
from fastapi.responses import StreamingResponse

from app.api.routes.jobs import shown
from app.api.services import Served
from app.jobs.events import BenchChanged, Event, JobChanged, JobSaid

router = APIRouter(prefix="/events", tags=["events"])
_TICK_S = 1.0
_SILENCE_TICKS = 15


@router.websocket("")
async def socket_events(socket: WebSocket, served: Served) -> None:
    """Every event as one JSON message; see `as_json`."""
    await socket.accept()
    with served.runner.bus.listen() as listener:
        watching = asyncio.create_task(_until_gone(socket))
        try:
            while not watching.done():
                event = await asyncio.to_thread(listener.next, _TICK_S)
                if event is not None and not watching.done():
                    await socket.send_text(json.dumps(as_json(event)))
        except WebSocketDisconnect:
            return
        finally:
            watching.cancel()


@router.get("/stream", response_class=StreamingResponse)
def stream_events(request: Request, served: Served) -> StreamingResponse:
    """The same as server-sent events."""

    async def events() -> AsyncIterator[str]:
        with served.runner.bus.listen() as listener:
            silent = 0
            while not await request.is_disconnected():
                event = await asyncio.to_thread(listener.next, _TICK_S)
                silent = silent + 1 if event is None else 0
                if event is not None:
                    yield f"data: {json.dumps(as_json(event))}\n\n"
                elif silent % _SILENCE_TICKS == 0:
                    yield ": still here\n\n"

    headers = {"Cache-Control": "no-store"}
    return StreamingResponse(events(), media_type="text/event-stream", headers=headers)


def as_json(event: Event) -> dict[str, Any]:
    """An event as it goes out; `type` says which it is."""
    if isinstance(event, JobChanged):
        return {"type": "job-changed", "job": shown(event.job).model_dump(mode="json")}
    if isinstance(event, JobSaid):
        return {"type": "job-said", "job_id": event.job_id, "line": event.line}
    if isinstance(event, BenchChanged):
        return {"type": "bench-changed"}
    return {"type": "points-added", "job_id": event.job_id, "points": event.points}


async def _until_gone(socket: WebSocket) -> None:
    """A client says nothing here; reading tells when it leaves."""
    try:
        while True:
            await socket.receive_text()
    except (WebSocketDisconnect, RuntimeError):
        return
