"""What stays open for long ends when the right to it does: a logout reaches sockets and streams, too."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass

from starlette.types import ASGIApp, Message, Receive, Scope, Send

_LOOK_AGAIN_S = 1.0


@dataclass(frozen=True, slots=True)
class SocketEnded:
    """The farewell."""

    code: int
    reason: str


async def ending_socket(
    app: ASGIApp, scope: Scope, receive: Receive, send: Send, holds: Callable[[], bool], end: SocketEnded
) -> None:
    """Serve a socket while the right to it holds; looked at once a second."""
    has_ended = is_accepted = False

    async def sending(message: Message) -> None:
        nonlocal is_accepted
        if not has_ended:
            is_accepted = is_accepted or message["type"] == "websocket.accept"
            await send(message)

    async def watching() -> None:
        while holds():
            await asyncio.sleep(_LOOK_AGAIN_S)

    serving = asyncio.ensure_future(app(scope, receive, sending))
    watch = asyncio.create_task(watching())
    try:
        await asyncio.wait((serving, watch), return_when=asyncio.FIRST_COMPLETED)
        if not serving.done():
            has_ended = True
            serving.cancel()
            if not is_accepted:
                await send({"type": "websocket.accept"})
            await send({"type": "websocket.close", "code": end.code, "reason": end.reason})
            await asyncio.wait((serving,))
        elif not serving.cancelled():
            serving.result()
    finally:
        for task in (serving, watch):
            task.cancel()
        await asyncio.gather(serving, watch, return_exceptions=True)


def ending_stream(receive: Receive, holds: Callable[[], bool]) -> Receive:
    """Tells an answer that looks whether its client is there that it is not, once the right has ended."""

    async def receiving() -> Message:
        return await receive() if holds() else {"type": "http.disconnect"}

    return receiving
