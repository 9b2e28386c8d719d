"""viser's own server, for this machine alone and without its way out into the internet."""

import contextlib
import io
import logging
import sys
import threading
from collections.abc import Iterator

from viser import ViserServer
from viser import _messages as viser_messages

# Of 128 large ones viser would make one frame, which must be there as a whole before it can be passed on.
_MESSAGES_IN_A_FRAME = 4
_log = logging.getLogger(__name__)


def open_viser() -> ViserServer:
    """A server on a free port of the loopback interface; nobody can ask it for a public address."""
    with _hushed(threading.current_thread()):
        server = ViserServer(host="127.0.0.1", port=0, verbose=False)
    # A bare socket reaches these handlers, whether or not the page has a button for them.
    for kind in (viser_messages.ShareUrlRequest, viser_messages.ShareUrlDisconnect):
        server._websock_server.unregister_handler(kind)
    server._websock_server._broadcast_buffer.max_window_size = _MESSAGES_IN_A_FRAME
    return server


def close_viser(server: ViserServer) -> None:
    """End the server and its threads."""
    with _hushed(server._websock_server._server_thread):
        server.stop()


def remote_port(server: ViserServer, client_id: int) -> int | None:
    """The port from which a client talks to viser; None when it has gone."""
    connection = server._websock_server._live_connections.get(client_id)
    return None if connection is None else int(connection.remote_address[1])


@contextlib.contextmanager
def _hushed(thread: threading.Thread | None) -> Iterator[None]:
    """What viser prints in that thread goes to the log; what others print goes where it should."""
    aside = _Aside(thread)
    with contextlib.redirect_stdout(aside):
        yield
    for line in filter(None, map(str.strip, aside.getvalue().splitlines())):
        _log.debug("viser: %s", line)


class _Aside(io.StringIO):
    def __init__(self, thread: threading.Thread | None) -> None:
        super().__init__()
        self._thread, self._usual = thread, sys.stdout

    def write(self, text: str) -> int:
        if threading.current_thread() is self._thread:
            return super().write(text)
        return self._usual.write(text)
