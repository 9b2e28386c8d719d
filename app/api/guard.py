"""Who may ask: pages of this server, on this machine. Nobody else is served until there is a login."""

from urllib.parse import urlsplit

from starlette.requests import HTTPConnection
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Receive, Scope, Send

_HOSTS = frozenset({"localhost", "127.0.0.1", "[::1]", "testserver"})
_FORBIDDEN = {
    "type": "turnscan:forbidden",
    "title": "This server answers its own pages on this machine only.",
    "status": 403,
    "hint": "Open http://localhost and the port that the server names.",
}
_HEADERS = (
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"same-origin"),
    (b"x-frame-options", b"SAMEORIGIN"),
)


class OwnPagesOnly:
    """Refuses other hosts (a page elsewhere may have its name point here) and other origins."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
        elif is_own(HTTPConnection(scope)):
            await self.app(scope, receive, _with_headers(send) if scope["type"] == "http" else send)
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
        else:
            await JSONResponse(_FORBIDDEN, 403, media_type="application/problem+json")(scope, receive, send)


def is_own(connection: HTTPConnection) -> bool:
    """Whether a request names this server as its host, and comes from no other page."""
    host = connection.headers.get("host", "")
    origin = connection.headers.get("origin")
    is_here = host.rsplit(":", 1)[0] in _HOSTS or host in _HOSTS
    return is_here and (origin is None or urlsplit(origin).netloc == host)


def _with_headers(send: Send) -> Send:
    async def sending(message: object) -> None:
        if isinstance(message, dict) and message["type"] == "http.response.start":
            there = {name for name, _ in message.get("headers", [])}
            message.setdefault("headers", []).extend(pair for pair in _HEADERS if pair[0] not in there)
        await send(message)  # type: ignore[arg-type]

    return sending
