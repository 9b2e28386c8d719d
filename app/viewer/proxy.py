"""viser behind our own server: its page, and its WebSocket passed on in both directions.

Sockets hold each other back: a slow page slows its own stream only, and viser then leaves out what has
been replaced meanwhile. Give `SOCKET_OPTIONS` to uvicorn: a whole scene may come as one frame of many
megabytes, which takes a slow page longer than the usual wait for an answer to a ping.
"""

import asyncio
import logging
import re
from collections.abc import Callable
from contextlib import suppress
from typing import Final, TypedDict
from urllib.parse import urlsplit

from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import BaseRoute, Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.typing import Subprotocol

from app.viewer.cloud_view import CloudView
from app.viewer.page import CONTENT_POLICY, viewer_page
from app.viewer.upward import WELCOME, kind_of

Guard = Callable[[Request | WebSocket], bool]
"""Whether the caller may see the view."""


class SocketOptions(TypedDict):
    """Those of uvicorn that the view needs."""

    ws_per_message_deflate: bool
    ws_ping_timeout: float


SOCKET_OPTIONS: Final[SocketOptions] = {"ws_per_message_deflate": False, "ws_ping_timeout": 180.0}

_DIALECT = "viser-v"
_TAB = re.compile(r"[A-Za-z0-9_-]{0,64}")
_MOST_REFUSALS = 8
_POLICY_VIOLATION, _TRY_LATER, _WRONG_VERSION, _GOING_AWAY = 1008, 1013, 1002, 1001
# Codes that tell of a connection without a farewell, and cannot be sent in one.
_UNSPOKEN = frozenset({1005, 1006, 1015})
_log = logging.getLogger(__name__)


def view_routes(view: CloudView, may_enter: Guard) -> list[BaseRoute]:
    """Routes for `/view/`, and for `/view/NAME/` by which a page can be told apart from others.

    Args:
        view: what is looked at.
        may_enter: asked for every page and every socket.
    """

    def page(request: Request) -> Response:
        if not may_enter(request):
            return PlainTextResponse("Log in first.", 401)
        if not _TAB.fullmatch(request.path_params.get("tab", "")):
            return PlainTextResponse("Not found.", 404)
        return _page(request)

    async def socket(down: WebSocket) -> None:
        tab = down.path_params.get("tab", "")
        if not _is_same_origin(down) or not may_enter(down) or not _TAB.fullmatch(tab):
            await down.close(_POLICY_VIOLATION)
            return
        await _serve(down, view, tab)

    paths = ("/view", "/view/", "/view/{tab}", "/view/{tab}/")
    return [
        *(Route(path, page, methods=["GET"], include_in_schema=False) for path in paths),
        *(WebSocketRoute(path, socket) for path in paths),
    ]


def _page(request: Request) -> Response:
    page = viewer_page()
    headers = {
        "ETag": page.etag,
        "Cache-Control": "no-cache",
        "Vary": "Accept-Encoding",
        "Content-Security-Policy": CONTENT_POLICY,
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "same-origin",
    }
    if page.etag in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    if "gzip" in request.headers.get("accept-encoding", ""):
        headers["Content-Encoding"] = "gzip"
        return Response(page.gzipped, headers=headers, media_type="text/html")
    return Response(page.plain, headers=headers, media_type="text/html")


def _is_same_origin(down: WebSocket) -> bool:
    """A browser says from which page it comes; what is no browser says nothing and is let pass."""
    origin = down.headers.get("origin")
    return origin is None or urlsplit(origin).netloc == down.headers.get("host")


async def _serve(down: WebSocket, view: CloudView, tab: str) -> None:
    spoken = next((name for name in down.scope["subprotocols"] if name.startswith(_DIALECT)), None)
    if spoken is None:
        await down.close(_POLICY_VIOLATION)
        return
    if spoken != viewer_page().dialect:
        # A page from before an update: it must be fetched again.
        await down.accept(subprotocol=spoken)
        await down.close(_WRONG_VERSION, f"this server speaks {viewer_page().dialect}")
        return
    try:
        # Loopback: no ping is needed, and a proxy from the environment would be wrong.
        up = await connect(
            f"ws://127.0.0.1:{view.port}/", subprotocols=[Subprotocol(spoken)], compression=None,
            max_size=None, max_queue=2, ping_interval=None, proxy=None,
        )  # fmt: skip
    except (OSError, InvalidHandshake) as error:
        _log.warning("the 3D view does not answer: %s", error)
        with suppress(OSError, WebSocketDisconnect):
            await down.close(_TRY_LATER)
        return
    async with up:
        port = up.local_address[1]
        view.entered(port, tab)
        try:
            await down.accept(subprotocol=up.subprotocol)
            await _pass_on(down, up)
        except (OSError, WebSocketDisconnect):
            _log.debug("a viewer of the 3D view left before it was connected")
        finally:
            view.left(port)


async def _pass_on(down: WebSocket, up: ClientConnection) -> None:
    ways = [asyncio.create_task(_upward(down, up)), asyncio.create_task(_downward(down, up))]
    try:
        await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for way in ways:
            way.cancel()
        ended = await asyncio.gather(*ways, return_exceptions=True)
    for outcome in ended:
        if isinstance(outcome, Exception) and not isinstance(outcome, ConnectionClosed | WebSocketDisconnect):
            raise outcome


async def _upward(down: WebSocket, up: ClientConnection) -> None:
    refused: set[str] = set()
    while True:
        event = await down.receive()
        if event["type"] == "websocket.disconnect":
            return
        message = event.get("bytes")
        kind = "(text)" if message is None else kind_of(message)
        if message is not None and kind in WELCOME:
            await up.send(message)
        elif kind not in refused and len(refused) < _MOST_REFUSALS:
            refused.add(kind)
            _log.warning("a page said what it may not say to the 3D view: %s", kind[:80])


async def _downward(down: WebSocket, up: ClientConnection) -> None:
    try:
        async for message in up:
            await down.send({"type": "websocket.send", "bytes": message})
    except ConnectionClosed:
        pass
    code = up.close_code or _GOING_AWAY
    await down.close(_GOING_AWAY if code in _UNSPOKEN else code, up.close_reason or None)
