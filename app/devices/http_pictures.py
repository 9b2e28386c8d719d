"""Pictures over HTTP: a stream of JPEG parts (multipart/x-mixed-replace), or one picture at a time.

Everybody writes such streams a little differently: the boundary with or without its dashes, the length of a
part told or not. A length that is told is believed; else the part ends before the next boundary.
"""

import base64
import contextlib
import socket
import ssl
import time
from collections.abc import Iterator
from dataclasses import dataclass
from email.message import Message
from http.client import HTTPConnection, HTTPException, HTTPResponse, HTTPSConnection
from urllib.parse import SplitResult, unquote, urljoin, urlsplit

from app.devices.camera_driver import RawFrame
from app.devices.jpeg import whole_jpeg
from app.errors import (
    DeviceDenied,
    DeviceError,
    DeviceLost,
    DeviceNotFound,
    DeviceTimeout,
    DeviceUnrecognised,
)

_MOST_BYTES = 64 * 2**20
_MOST_LINE = 8192
_MOST_HEADERS = 64
_MOST_REDIRECTS = 3
_REDIRECTS = frozenset({301, 302, 303, 307, 308})
_PAGE_HINT = (
    "Give the address of the video itself, such as http://HOST:8080/video (IP Webcam) or "
    "http://HOST:4747/video (DroidCam)."
)
_APP_HINT = "Start the camera's server or app, and check the address and that both are in the same network."


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


class HttpPictures:
    """An open stream, or a place that gives a picture whenever it is asked.

    Args:
        device: what messages call the camera.
        address: where it is.
        fps: how often a place that gives single pictures is asked.
    """

    def __init__(self, device: str, address: Address, fps: float) -> None:
        self._device, self._address, self._pause_s = device, address, 1.0 / fps
        self._response, self._socket = _request(device, address)
        kind = self._response.headers.get_content_type()
        self._boundary = b""
        self._next_s = time.monotonic()
        if kind.startswith("multipart/"):
            boundary = self._response.headers.get_param("boundary")
            self._boundary = str(boundary or "").strip("-").encode()
        elif kind != "image/jpeg":
            self.close()
            if kind == "text/html":
                raise DeviceUnrecognised(device, f"{address.shown} is a web page, no camera", _PAGE_HINT)
            raise DeviceUnrecognised(device, f"{address.shown} sends {kind}, no JPEG pictures", _PAGE_HINT)
        self._is_stream = kind.startswith("multipart/")
        self._is_fetched = False

    def read(self) -> RawFrame | None:
        with self._sentences():
            data = self._part() if self._is_stream else self._single()
        if not data:
            return None
        with contextlib.suppress(ValueError):
            data = whole_jpeg(data)
        return RawFrame(data)

    def interrupt(self) -> None:
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        self._response.close()
        self._socket.close()

    def _single(self) -> bytes:
        if self._is_fetched:
            time.sleep(max(0.0, self._next_s - time.monotonic()))
            self.close()
            self._response, self._socket = _request(self._device, self._address)
        self._next_s = time.monotonic() + self._pause_s
        self._is_fetched = True
        return self._response.read(_MOST_BYTES)

    def _part(self) -> bytes:
        headers = self._headers()
        length = headers.get("Content-Length", "")
        if length.isdigit():
            if int(length) > _MOST_BYTES:
                raise DeviceUnrecognised(self._device, f"{self._address.shown} sends pictures without end")
            data = self._response.read(int(length))
            if len(data) < int(length):
                raise EOFError
            return data
        return self._until_boundary()

    def _headers(self) -> Message:
        """Of the next part; boundaries and empty lines before them are passed over."""
        headers = Message()
        for _ in range(_MOST_HEADERS):
            line = self._response.readline(_MOST_LINE)
            if not line:
                raise EOFError
            name, colon, value = line.decode("latin-1").partition(":")
            if not line.strip():
                if len(headers):
                    return headers
            elif colon and not line.startswith(b"--"):
                headers[name.strip()] = value.strip()
        raise DeviceUnrecognised(
            self._device, f"{self._address.shown} sends no pictures that can be made out"
        )

    def _until_boundary(self) -> bytes:
        data = bytearray()
        while len(data) < _MOST_BYTES:
            line = self._response.readline(_MOST_LINE)
            if not line:
                raise EOFError
            if line.startswith(b"--") and self._boundary in line:
                return bytes(data)
            data += line
        raise DeviceUnrecognised(self._device, f"{self._address.shown} sends pictures without end")

    @contextlib.contextmanager
    def _sentences(self) -> Iterator[None]:
        try:
            yield
        except (DeviceNotFound, DeviceTimeout) as error:
            raise DeviceLost(self._device, error.problem) from error
        except TimeoutError as error:
            raise DeviceLost(self._device, f"{self._address.shown} has fallen silent") from error
        except (EOFError, HTTPException, OSError, ValueError) as error:
            raise DeviceLost(self._device, f"{self._address.shown} has closed the connection") from error


def _request(device: str, address: Address) -> tuple[HTTPResponse, socket.socket]:
    """An answer with pictures in it, and the connection that it comes over."""
    secret = _authorization(address.parts)
    for _ in range(_MOST_REDIRECTS + 1):
        response, connection = _ask(device, address, secret)
        target = response.getheader("Location")
        if response.status in _REDIRECTS and target:
            response.close()
            connection.close()
            following = Address(urljoin(address.url, target), address.checks_certificate, address.timeout_s)
            if following.parts.hostname != address.parts.hostname:
                secret = {}
            address = following
            continue
        if response.status == 200:
            return response, connection
        response.close()
        connection.close()
        raise _refusal(device, address, response.status, response.reason)
    raise DeviceUnrecognised(device, f"{address.shown} sends one from place to place", _PAGE_HINT)


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
        raise DeviceUnrecognised(device, f"{where} does not speak HTTP", _PAGE_HINT) from error
    except ValueError as error:
        raise DeviceNotFound(device, f"{where} is no address of a camera", _PAGE_HINT) from error


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
        return DeviceNotFound(device, f"there is nothing at {where} (404)", _PAGE_HINT)
    if status == 503:
        return DeviceDenied(device, f"{where} is busy (503)", "Close other programs that watch this camera.")
    return DeviceUnrecognised(device, f"{where} answers {status} {reason}".rstrip(), _PAGE_HINT)
