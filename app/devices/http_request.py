"""Asking a camera over HTTP: redirects followed, every refusal a sentence, and nothing secret in any."""

import base64
import socket
import ssl
from dataclasses import dataclass
from http.client import HTTPConnection, HTTPException, HTTPResponse, HTTPSConnection
from urllib.parse import SplitResult, unquote, urljoin, urlsplit

from app.errors import DeviceDenied, DeviceError, DeviceNotFound, DeviceTimeout, DeviceUnrecognised

PAGE_HINT = (
    "Give the address of the video itself, such as http://HOST:8080/video (IP Webcam) or "
    "http://HOST:4747/video (DroidCam)."
)
_APP_HINT = "Start the camera's server or app, and check the address and that both are in the same network."
_MOST_REDIRECTS = 3
_REDIRECTS = frozenset({301, 302, 303, 307, 308})


@dataclass(frozen=True, slots=True)
class Address:
    """Where pictures are fetched; never shown with what may be secret in it.

    Attributes:
        url: whole.
        checks_certificate: whether an encrypted connection must be to whom it claims; cameras at home can
            seldom prove that.
        timeout_s: for connecting, and for a silence between bytes.
    """

    url: str
    checks_certificate: bool
    timeout_s: float

    @property
    def shown(self) -> str:
        """Without name, password and query."""
        return shown(self.url)

    @property
    def parts(self) -> SplitResult:
        return urlsplit(self.url)


def shown(url: str) -> str:
    """A URL as it may be printed: without name, password and query."""
    parts = urlsplit(url)
    host = parts.netloc.rpartition("@")[2]
    return f"{parts.scheme}://{host}{parts.path}" + ("?..." if parts.query else "")


def request(device: str, address: Address) -> tuple[HTTPResponse, socket.socket]:
    """An answer with pictures in it, and the connection that it comes over."""
    secret = _authorization(address.parts)
    for _ in range(_MOST_REDIRECTS + 1):
        response, connection = _ask(device, address, secret)
        target = response.getheader("Location")
        if response.status in _REDIRECTS and target:
            response.close()
            connection.close()
            following = Address(urljoin(address.url, target), address.checks_certificate, address.timeout_s)
            is_less_safe = address.parts.scheme == "https" and following.parts.scheme != "https"
            if is_less_safe or following.parts.hostname != address.parts.hostname:
                secret = {}
            address = following
            continue
        if response.status == 200:
            return response, connection
        response.close()
        connection.close()
        raise _refusal(device, address, response.status, response.reason)
    raise DeviceUnrecognised(device, f"{address.shown} sends one from place to place", PAGE_HINT)


def _ask(device: str, address: Address, secret: dict[str, str]) -> tuple[HTTPResponse, socket.socket]:
    parts, where = address.parts, address.shown
    try:
        if not parts.hostname or parts.scheme not in ("http", "https"):
            raise ValueError(parts.scheme)
        connection = _connection(address)
        path = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
        connection.connect()
        link = connection.sock
        try:
            connection.request("GET", path, headers={"Accept": "*/*", "Connection": "close", **secret})
            return connection.getresponse(), link
        except BaseException:
            link.close()
            raise
    except socket.gaierror as error:
        raise DeviceNotFound(device, f"no machine is known as {parts.hostname}", _APP_HINT) from error
    except TimeoutError as error:
        raise DeviceTimeout(device, f"open {where}", address.timeout_s, _APP_HINT) from error
    except ssl.SSLError as error:
        hint = "Use http:// instead, or set checks_certificate = false in the bench file."
        raise DeviceUnrecognised(device, f"{where} cannot prove who it is", hint) from error
    except OSError as error:
        raise DeviceNotFound(device, f"nothing answers at {where}", _APP_HINT) from error
    except HTTPException as error:
        raise DeviceUnrecognised(device, f"{where} does not speak HTTP", PAGE_HINT) from error
    except ValueError as error:
        raise DeviceNotFound(device, f"{where} is no address of a camera", PAGE_HINT) from error


def _connection(address: Address) -> HTTPConnection:
    parts = address.parts
    host = parts.hostname or ""
    if parts.scheme == "http":
        return HTTPConnection(host, parts.port, timeout=address.timeout_s)
    context = ssl.create_default_context()
    if not address.checks_certificate:
        context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    return HTTPSConnection(host, parts.port, timeout=address.timeout_s, context=context)


def _authorization(parts: SplitResult) -> dict[str, str]:
    if parts.username is None:
        return {}
    pair = f"{unquote(parts.username)}:{unquote(parts.password or '')}"
    return {"Authorization": f"Basic {base64.b64encode(pair.encode()).decode()}"}


def _refusal(device: str, address: Address, status: int, reason: str) -> DeviceError:
    where = address.shown
    if status in (401, 403):
        hint = (
            "Write the name and password that the camera wants into the address: http://NAME:PASSWORD@HOST/."
        )
        return DeviceDenied(device, f"{where} wants another name or password ({status})", hint)
    if status == 404:
        return DeviceNotFound(device, f"there is nothing at {where} (404)", PAGE_HINT)
    if status == 503:
        return DeviceDenied(device, f"{where} is busy (503)", "Close other programs that watch this camera.")
    return DeviceUnrecognised(device, f"{where} answers {status} {reason}".rstrip(), PAGE_HINT)
