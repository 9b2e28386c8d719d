"""What every answer tells the browser to refuse."""

from collections.abc import Iterable

from starlette.requests import HTTPConnection
from starlette.types import Message, Send

CONTENT_POLICY = "; ".join(
    (
        "default-src 'self'",
        "img-src 'self' blob: data:",
        "media-src 'self' blob:",
        "object-src 'none'",
        "frame-ancestors 'self'",
        "base-uri 'none'",
        "form-action 'self'",
    )
)
"""Of our own pages: nothing from elsewhere, no script or style within a page; pictures may be made by it."""

_ALWAYS = (
    ("content-security-policy", CONTENT_POLICY),
    ("x-content-type-options", "nosniff"),
    ("x-frame-options", "SAMEORIGIN"),
    ("referrer-policy", "same-origin"),
    ("cross-origin-resource-policy", "same-origin"),
    (
        "permissions-policy",
        "camera=(), microphone=(), geolocation=(), payment=(), usb=(), serial=(), midi=()",
    ),
)
# A browser ignores it on plain HTTP from another machine, and complains.
_WHERE_TRUSTED = ("cross-origin-opener-policy", "same-origin")
_OVER_TLS = ("strict-transport-security", "max-age=2592000")
_OF_THE_API = ("cache-control", "private, no-cache")
NAMES_OF_THIS_MACHINE = frozenset({"localhost", "127.0.0.1", "[::1]"})


def host_name(connection: HTTPConnection) -> str:
    """By what name or address the client calls this server, without the port."""
    host = connection.headers.get("host", "").lower()
    name, colon, port = host.rpartition(":")
    return name if colon and port.isdecimal() else host


def safe_headers(connection: HTTPConnection) -> dict[str, str]:
    """Those that an answer has unless it says otherwise."""
    headers = dict(_ALWAYS)
    is_tls = connection.scope["scheme"] == "https"
    if is_tls or host_name(connection) in NAMES_OF_THIS_MACHINE:
        headers.update((_WHERE_TRUSTED,))
    if is_tls:
        headers.update((_OVER_TLS,))
    if connection.scope["path"].startswith("/api/"):
        headers.update((_OF_THE_API,))
    return headers


def with_safe_headers(connection: HTTPConnection, send: Send) -> Send:
    """The same, with those headers in every answer that lacks them."""

    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            there: Iterable[tuple[bytes, bytes]] = message.get("headers", ())
            names = {name.lower() for name, _ in there}
            added = [
                (name.encode(), text.encode())
                for name, text in safe_headers(connection).items()
                if name.encode() not in names
            ]
            message = {**message, "headers": [*there, *added]}
        await send(message)

    return sending
