"""Who may ask, looked at before anything else is: nothing of the server answers past this."""

import asyncio
import ipaddress
from http import HTTPStatus
from typing import Final
from urllib.parse import quote

from starlette.requests import HTTPConnection
from starlette.responses import RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.access.access import Access, Kind, Pass
from app.api.headers import NAMES_OF_THIS_MACHINE, host_name, with_safe_headers
from app.api.held import SocketEnded, ending_socket, ending_stream
from app.api.problems import answer_of
from app.api.small_body import SMALL_BYTES, read_small
from app.api.versioned import API
from app.errors import AccessFileError, BodyTooLarge, NotLetIn, RefusedHere, ScannerError

HEALTH, LOGIN = "/healthz", "/login"
NOT_LOGGED_IN = 4401
"""Code by which a WebSocket ends for who is not, or no more, logged in: it is accepted first, since a page
cannot tell why a handshake failed."""

_OPEN: Final = frozenset(
    {
        ("GET", LOGIN),
        ("GET", f"{LOGIN}/login.css"),
        ("GET", f"{LOGIN}/login.js"),
        ("GET", "/favicon.svg"),
        ("GET", f"{API}/access"),
        ("POST", f"{API}/access/login"),
    }
)
_PASSED_ON = ("forwarded", "x-forwarded-for", "x-forwarded-host", "x-real-ip")
_PASS = "turnscan.pass"


class Guard:
    """Lets in whom `Access` lets in, and pages of this server only; ends what is open when that ends."""

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self.app, self._access = app, access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        connection = HTTPConnection(scope)
        if scope["type"] == "http":
            send = with_safe_headers(connection, send)
        try:
            scope[_PASS] = held = self._let_in(connection)
        except ScannerError as error:
            await _refuse(connection, error)(scope, receive, send)
            return
        if held is None:
            await self._serve_stranger(scope, receive, send)
        elif scope["type"] == "http":
            await self.app(scope, ending_stream(receive, lambda: self._access.holds(held)), send)
        else:
            end = SocketEnded(NOT_LOGGED_IN, "log in again")
            await ending_socket(self.app, scope, receive, send, lambda: self._access.holds(held), end)
        if self._access.has_news:
            await asyncio.to_thread(self._access.save_seen)

    def _let_in(self, connection: HTTPConnection) -> Pass | None:
        """Nothing stands for a stranger at a place that is open to all.

        Raises:
            RefusedHere, NotLetIn, AccessFileError: he may not enter.
        """
        scope = connection.scope
        method = scope.get("method", "")
        what = ("GET" if method == "HEAD" else method, scope["path"])
        if what == ("GET", HEALTH):
            return None
        if not self._access.is_understood and what in _OPEN:
            # The login page says what is wrong.
            return None
        if self._access.is_open():
            _check_local(connection)
            _check_own_page(connection)
            return Pass(Kind.OPEN)
        way, _, token = connection.headers.get("authorization", "").partition(" ")
        if way.lower() == "bearer":
            # No browser sends it by itself, so no other page can misuse it.
            if held := self._access.let_in_by_token(token.strip()):
                return held
            raise NotLetIn("The token is not valid, or not any more.")
        _check_own_page(connection)
        if held := self._access.let_in_by_cookie(connection.cookies.get(cookie_name(connection), "")):
            return held
        if what in _OPEN:
            return None
        raise NotLetIn("Log in first.")

    async def _serve_stranger(self, scope: Scope, receive: Receive, send: Send) -> None:
        body = await read_small(receive)
        if body is None:
            problem = BodyTooLarge(f"Before the login a request has at most {SMALL_BYTES} bytes.")
            await answer_of(problem)(scope, receive, send)
            return
        await self.app(scope, body, send)


def pass_of(connection: HTTPConnection) -> Pass | None:
    """By what this request was let in; nothing for a stranger, and where there is no guard."""
    held = connection.scope.get(_PASS)
    return held if isinstance(held, Pass) else None


def cookie_name(connection: HTTPConnection) -> str:
    """Of the session; a browser takes the longer one over TLS only, for this very host."""
    return "__Host-turnscan" if connection.scope["scheme"] in ("https", "wss") else "turnscan"


def is_local_path(text: str) -> bool:
    """Whether it leads to a page of this server, however a browser reads it."""
    return text.startswith("/") and text[1:2] not in ("/", "\\") and text.isprintable() and len(text) < 2000


def _check_local(connection: HTTPConnection) -> None:
    client = connection.client.host if connection.client else ""
    host = host_name(connection)
    is_passed_on = any(name in connection.headers for name in _PASSED_ON)
    if host not in NAMES_OF_THIS_MACHINE or is_passed_on or not _is_this_machine(client):
        raise RefusedHere(
            "Without a password this server answers its own pages on this machine only.",
            "Open http://localhost and the port that the server names, or set a password with "
            "`turnscan password`.",
        )


def _check_own_page(connection: HTTPConnection) -> None:
    """A browser says from where a request comes; what is no browser says nothing and is let pass."""
    host = connection.headers.get("host", "").lower()
    origins = connection.headers.getlist("origin")
    is_foreign = any(origin.lower().partition("://")[2] != host for origin in origins)
    if connection.headers.get("sec-fetch-site") == "cross-site":
        is_foreign = is_foreign or not _is_followed_link(connection)
    if is_foreign:
        raise RefusedHere("This server obeys its own pages only.", "Open the server's own address.")


def _is_followed_link(connection: HTTPConnection) -> bool:
    headers = connection.headers
    return (
        connection.scope.get("method") in ("GET", "HEAD")
        and headers.get("sec-fetch-mode") == "navigate"
        and headers.get("sec-fetch-dest") == "document"
    )


def _is_this_machine(client: str) -> bool:
    try:
        address = ipaddress.ip_address(client)
    except ValueError:
        # A Unix socket has no address.
        return True
    mapped = address.ipv4_mapped if isinstance(address, ipaddress.IPv6Address) else None
    return (mapped or address).is_loopback


def _refuse(connection: HTTPConnection, error: ScannerError) -> ASGIApp:
    if connection.scope["type"] == "websocket":
        return _close_socket if isinstance(error, NotLetIn | AccessFileError) else _refuse_socket
    if isinstance(error, NotLetIn | AccessFileError) and _wants_page(connection):
        return _to_login(connection)
    return answer_of(error)


def _wants_page(connection: HTTPConnection) -> bool:
    headers = connection.headers
    return (
        connection.scope["method"] in ("GET", "HEAD")
        and not connection.scope["path"].startswith("/api/")
        and "text/html" in headers.get("accept", "")
        and headers.get("sec-fetch-dest", "document") == "document"
    )


def _to_login(connection: HTTPConnection) -> Response:
    asked = connection.scope["query_string"].decode("latin-1")
    there = quote(connection.scope["path"]) + (f"?{asked}" if asked else "")
    # A fragment, which the server is not told, is kept by the browser itself.
    query = f"?next={quote(there, safe='')}" if is_local_path(there) and there != "/" else ""
    return RedirectResponse(LOGIN + query, HTTPStatus.SEE_OTHER, {"Cache-Control": "no-store"})


async def _close_socket(scope: Scope, receive: Receive, send: Send) -> None:
    accept: Message = {"type": "websocket.accept", "subprotocol": next(iter(scope["subprotocols"]), None)}
    await receive()
    await send(accept)
    await send({"type": "websocket.close", "code": NOT_LOGGED_IN, "reason": "log in first"})


async def _refuse_socket(scope: Scope, receive: Receive, send: Send) -> None:
    await send({"type": "websocket.close", "code": 1008})
