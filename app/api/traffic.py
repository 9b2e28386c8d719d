"""What goes out to clients, and when anybody last showed that they are there."""

import time
from collections import Counter
from collections.abc import Mapping

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.api.versioned import API

# Machines ask for these by themselves, whether anybody is there or not.
_UNATTENDED = ("/metrics", f"{API}/health", "/health")
_LIVE = f"{API}/live"
_WAYS = (_LIVE, f"{API}/events", "/view")


class Traffic:
    """Counts bytes by way (live, events, view, other) and notes signs of life; used in the event loop only.

    Somebody is there who asks for something, takes live pictures, or waits for a command's end. News and the
    3D view are taken by pages that nobody looks at, too, and by phones that have long been out of reach.
    """

    def __init__(self) -> None:
        self._bytes: Counter[str] = Counter()
        self._commands = 0
        self._seen_s = time.monotonic()

    @property
    def bytes_sent(self) -> Mapping[str, int]:
        """By way; any thread may look."""
        return dict(self._bytes)

    @property
    def seen_s(self) -> float:
        """Monotonic time at which somebody was there last."""
        return time.monotonic() if self._commands else self._seen_s

    def note(self) -> None:
        """Somebody is there."""
        self._seen_s = time.monotonic()

    def count(self, path: str, size: int) -> None:
        self._bytes[next((way.rsplit("/", 1)[-1] for way in _WAYS if path.startswith(way)), "other")] += size

    def begin_command(self) -> None:
        self._commands += 1

    def end_command(self) -> None:
        self._commands -= 1
        self.note()


class TrafficCounted:
    """Tells a `Traffic` of every request and socket."""

    def __init__(self, app: ASGIApp, traffic: Traffic) -> None:
        self.app, self._traffic = app, traffic

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        traffic, path = self._traffic, scope["path"]
        is_attended = not path.startswith(_UNATTENDED)
        is_command = is_attended and scope.get("method", "GET") not in ("GET", "HEAD", "OPTIONS")

        async def receiving() -> Message:
            if is_command:
                # Whoever has not said all of it yet may have gone in the middle.
                traffic.end_command()
            try:
                message = await receive()
            finally:
                if is_command:
                    traffic.begin_command()
            if is_attended and not message["type"].endswith("disconnect"):
                traffic.note()
            return message

        async def sending(message: Message) -> None:
            await send(message)
            if path.startswith(_LIVE):
                traffic.note()
            traffic.count(
                path, len(message.get("body") or message.get("bytes") or message.get("text") or b"")
            )

        if is_attended:
            traffic.note()
        if is_command:
            traffic.begin_command()
        try:
            await self.app(scope, receiving, sending)
        finally:
            if is_command:
                traffic.end_command()
