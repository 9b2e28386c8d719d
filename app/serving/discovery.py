"""Being found in the network as `turnscan.local`, where the library for it is installed."""

import logging
import socket
import threading
from collections.abc import Sequence
from types import TracebackType
from typing import Any, Self

_SERVICE = "_http._tcp.local."
_log = logging.getLogger(__name__)


class Discovery:
    """Announces the server while it is entered. Takes place in a thread, and failing is only logged.

    Args:
        name: it is found as `NAME.local`; with a number behind it where another machine has that.
        port: of the server.
        is_encrypted: whether it speaks HTTPS.
        addresses: of this machine in its networks.
        interfaces: where to speak, by default at all of the addresses.
    """

    def __init__(
        self,
        name: str,
        port: int,
        *,
        is_encrypted: bool,
        addresses: Sequence[str],
        interfaces: Sequence[str] | None = None,
    ) -> None:
        self._name, self._port, self._is_encrypted = name, port, is_encrypted
        self._addresses = tuple(addresses)
        self._interfaces = tuple(addresses if interfaces is None else interfaces)
        self._zeroconf: Any = None
        self._thread = threading.Thread(target=self._announce, name="mdns", daemon=True)
        self._lock = threading.Lock()
        self._is_over = False
        self.is_announced = threading.Event()

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._lock:
            self._is_over = True
            zeroconf, self._zeroconf = self._zeroconf, None
        if zeroconf is not None:
            _close(zeroconf)

    def _announce(self) -> None:
        try:
            from zeroconf import ServiceInfo, Zeroconf
        except ImportError:
            _log.info("zeroconf is not installed (`pip install 'turnscan[mdns]'`), so there is no %s", self)
            return
        try:
            speaker = Zeroconf(interfaces=list(self._interfaces))
            with self._lock:
                is_over = self._is_over
                self._zeroconf = None if is_over else speaker
            if is_over:
                _close(speaker)
                return
            info = ServiceInfo(
                _SERVICE, f"{self._name}.{_SERVICE}", port=self._port, server=f"{self._name}.local.",
                parsed_addresses=list(self._addresses),
                properties={"path": "/", "scheme": "https" if self._is_encrypted else "http"},
            )  # fmt: skip
            speaker.register_service(info, allow_name_change=True)
            self.is_announced.set()
            _log.info("found in the network as %s", self)
        except Exception as error:  # noqa: BLE001 (edge of a thread: the server does without)
            if not self._is_over:
                _log.warning("the network is not told of %s: %s", self, error or type(error).__name__)

    def __str__(self) -> str:
        return f"{self._name}.local"


def _close(zeroconf: Any) -> None:
    try:
        zeroconf.close()
    except Exception as error:  # noqa: BLE001 (a farewell to a network that may be gone)
        _log.debug("no farewell to the network: %s", error)


def host_name() -> str:
    """How this machine calls itself; empty where that is no name for a network."""
    name = socket.gethostname().split(".")[0].lower()
    return name if name.replace("-", "").isalnum() and name.isascii() else ""
