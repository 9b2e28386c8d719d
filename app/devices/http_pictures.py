"""Pictures over HTTP: a stream of JPEG parts (multipart/x-mixed-replace), or one picture at a time.

Everybody writes such streams a little differently: the boundary with or without its dashes, the length of a
part told or not. A length that is told is believed; else the part ends before the next boundary.
"""

import contextlib
import socket
import time
from collections.abc import Iterator
from email.message import Message
from http.client import HTTPException

from app.devices.camera_driver import RawFrame
from app.devices.http_request import PAGE_HINT, Address, request
from app.devices.jpeg import whole_jpeg
from app.errors import DeviceLost, DeviceNotFound, DeviceTimeout, DeviceUnrecognised

_MOST_BYTES = 64 * 2**20
_MOST_LINE = 8192
_MOST_HEADERS = 64


class HttpPictures:
    """An open stream, or a place that gives a picture whenever it is asked.

    Args:
        device: what messages call the camera.
        address: where it is.
        fps: how often a place that gives single pictures is asked.
    """

    def __init__(self, device: str, address: Address, fps: float) -> None:
        self._device, self._address, self._pause_s = device, address, 1.0 / fps
        self._response, self._socket = request(device, address)
        kind = self._response.headers.get_content_type()
        self._boundary = b""
        self._next_s = time.monotonic()
        if kind.startswith("multipart/"):
            boundary = self._response.headers.get_param("boundary")
            self._boundary = str(boundary or "").strip("-").encode()
        elif kind != "image/jpeg":
            self.close()
            if kind == "text/html":
                raise DeviceUnrecognised(device, f"{address.shown} is a web page, no camera", PAGE_HINT)
            raise DeviceUnrecognised(device, f"{address.shown} sends {kind}, no JPEG pictures", PAGE_HINT)
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
            self._response, self._socket = request(self._device, self._address)
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
