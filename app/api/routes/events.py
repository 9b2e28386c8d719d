"""News as they happen, over a WebSocket or as server-sent events."""

import asyncio
from collections.abc import AsyncIterator
from typing import Annotated, Literal, TypeAlias

from fastapi import APIRouter, Request, WebSocket, WebSocketDisconnect
from fastapi.responses import StreamingResponse
from pydantic import BaseModel, Field, RootModel

from app.api.routes.jobs import JobOut, shown
from app.api.services import Served
from app.jobs.events import BenchChanged, Event, JobChanged, JobSaid

router = APIRouter(prefix="/events", tags=["events"])
_TICK_S = 1.0
_SILENCE_TICKS = 15


class JobChangedOut(BaseModel):
    """A job stands differently."""

    type: Literal["job-changed"]
    job: JobOut


class JobSaidOut(BaseModel):
    """A job has a line for its log."""

    type: Literal["job-said"]
    job_id: str
    line: str


class PointsAddedOut(BaseModel):
    """A scan has so many points by now."""

    type: Literal["points-added"]
    job_id: str
    points: int


class BenchChangedOut(BaseModel):
    """Something about the bench is different: ask how it stands."""

    type: Literal["bench-changed"]


News: TypeAlias = JobChangedOut | JobSaidOut | PointsAddedOut | BenchChangedOut


class NewsOut(RootModel[Annotated[News, Field(discriminator="type")]]):
    """One event, over the socket or in the stream; `type` says which it is."""


@router.websocket("")
async def socket_events(socket: WebSocket, served: Served) -> None:
    """Every event as one JSON message; see `NewsOut`."""
    await socket.accept()
    with served.runner.bus.listen() as listener:
        watching = asyncio.create_task(_until_gone(socket))
        try:
            while not watching.done():
                event = await asyncio.to_thread(listener.next, _TICK_S)
                if event is not None and not watching.done():
                    await socket.send_text(as_json(event))
        except WebSocketDisconnect:
            return
        finally:
            watching.cancel()


@router.get("/stream", response_class=StreamingResponse, responses={200: {"model": NewsOut}})
def stream_events(request: Request, served: Served) -> StreamingResponse:
    """The same as server-sent events."""

    async def events() -> AsyncIterator[str]:
        with served.runner.bus.listen() as listener:
            silent = 0
            while not await request.is_disconnected():
                event = await asyncio.to_thread(listener.next, _TICK_S)
                silent = silent + 1 if event is None else 0
                if event is not None:
                    yield f"data: {as_json(event)}\n\n"
                elif silent % _SILENCE_TICKS == 0:
                    yield ": still here\n\n"

    headers = {"Cache-Control": "no-store"}
    return StreamingResponse(events(), media_type="text/event-stream", headers=headers)


def as_json(event: Event) -> str:
    """An event as it goes out."""
    return _news(event).model_dump_json()


def _news(event: Event) -> News:
    if isinstance(event, JobChanged):
        return JobChangedOut(type="job-changed", job=shown(event.job))
    if isinstance(event, JobSaid):
        return JobSaidOut(type="job-said", job_id=event.job_id, line=event.line)
    if isinstance(event, BenchChanged):
        return BenchChangedOut(type="bench-changed")
    return PointsAddedOut(type="points-added", job_id=event.job_id, points=event.points)


async def _until_gone(socket: WebSocket) -> None:
    """A client says nothing here; reading tells when it leaves."""
    try:
        while True:
            await socket.receive_text()
    except (WebSocketDisconnect, RuntimeError):
        return
