"""Sending to clients that may have stopped reading: after a while they are given up."""

import asyncio
from collections.abc import Awaitable, Coroutine
from typing import Any

import anyio
from starlette.responses import StreamingResponse
from starlette.types import Send
from starlette.websockets import WebSocketDisconnect

# Whoever takes nothing for so long will not come back; what is sent waits in bounded buffers until then.
PATIENCE_S = 20.0


class StalledError(OSError):
    """A client takes nothing any more."""


async def sent(sending: Awaitable[None]) -> None:
    """Wait for something to be sent.

    Raises:
        StalledError: the client took nothing in time.
    """
    try:
        async with asyncio.timeout(PATIENCE_S):
            await sending
    except TimeoutError as error:
        raise StalledError("the client reads nothing") from error


async def until_one_ends(*ways: Coroutine[Any, Any, None]) -> None:
    """Both ways of a socket: when one has ended, or the client has gone, the other ends, too."""
    async with anyio.create_task_group() as group:

        async def go(way: Coroutine[Any, Any, None]) -> None:
            try:
                await way
            except (WebSocketDisconnect, StalledError, RuntimeError):
                # A closed socket is told by whichever of them its next use comes to.
                pass
            finally:
                group.cancel_scope.cancel()

        for way in ways:
            group.start_soon(go, way)


class PatientResponse(StreamingResponse):
    """A stream that ends when its client has stopped reading."""

    async def stream_response(self, send: Send) -> None:
        start = {"type": "http.response.start", "status": self.status_code, "headers": self.raw_headers}
        await sent(send(start))
        try:
            async for piece in self.body_iterator:
                data = piece if isinstance(piece, bytes | memoryview) else piece.encode(self.charset)
                await sent(send({"type": "http.response.body", "body": data, "more_body": True}))
        finally:
            # A generator that is not read to its end would be closed some time later.
            closing = getattr(self.body_iterator, "aclose", None)
            if closing is not None:
                await closing()
        await sent(send({"type": "http.response.body", "body": b"", "more_body": False}))
