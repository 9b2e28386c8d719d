"""What systemd is told: that the server is ready, still alive, and ending. Elsewhere nobody is told."""

import contextlib
import socket


class Notifier:
    """Speaks to the service manager; nothing happens where there is none, and nothing ever fails.

    Args:
        address: of its datagram socket, a path or `@` and an abstract name; empty for none.
        watchdog_s: within what time it wants a sign of life; 0 where it wants none.
    """

    def __init__(self, address: str = "", watchdog_s: float = 0.0) -> None:
        self._address = f"\0{address[1:]}" if address.startswith("@") else address
        self.watchdog_s = watchdog_s

    def ready(self, status: str) -> None:
        """Requests are answered."""
        self._send(f"READY=1\nSTATUS={status}")

    def alive(self) -> None:
        """A sign of life."""
        self._send("WATCHDOG=1")

    def stopping(self) -> None:
        """The end has begun."""
        self._send("STOPPING=1")

    def _send(self, text: str) -> None:
        if not self._address:
            return
        with (
            contextlib.suppress(OSError),
            socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as speaker,
        ):
            speaker.setblocking(False)
            speaker.sendto(text.encode(), self._address)
