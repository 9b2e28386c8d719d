"""How often a password may be tried: the more attempts have failed, the longer the next one waits."""

import ipaddress
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from app.errors import TooManyAttempts

_MOST_ADDRESSES = 1000


@dataclass(frozen=True, slots=True)
class Patience:
    """With one caller, or with all together.

    Attributes:
        free: attempts before there is any wait.
        longest_s: the wait doubles from one second up to this.
        forgets_s: after so long without an attempt all is as at the beginning.
    """

    free: int
    longest_s: float
    forgets_s: float


@dataclass(slots=True)
class _Tally:
    count: int = 0
    last_s: float = 0.0

    def wait_s(self, patience: Patience, now_s: float) -> float:
        if now_s - self.last_s >= patience.forgets_s:
            self.count = 0
        if self.count < patience.free:
            return 0.0
        doubled = 2.0 ** min(self.count - patience.free, 30)
        return self.last_s + min(doubled, patience.longest_s) - now_s

    def note(self, now_s: float) -> None:
        self.count, self.last_s = self.count + 1, now_s


class Attempts:
    """Counts them. Every attempt counts as failed until it has succeeded, so that many at once gain nothing.

    An address from which somebody has logged in before does not wait for what others do.
    """

    each = Patience(free=5, longest_s=900.0, forgets_s=3600.0)
    together = Patience(free=30, longest_s=30.0, forgets_s=600.0)

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        self._now_s = now_s
        self._lock = threading.Lock()
        self._all = _Tally()
        self._by_address: dict[str, _Tally] = {}
        self._known: dict[str, None] = {}

    def begin(self, client: str) -> None:
        """Count an attempt from that address, unless it comes too early.

        Raises:
            TooManyAttempts: it does, and does not count.
        """
        address = _neighbourhood(client)
        with self._lock:
            now = self._now_s()
            own = self._by_address.get(address) or _Tally()
            wait = own.wait_s(self.each, now)
            if address not in self._known:
                wait = max(wait, self._all.wait_s(self.together, now))
            if wait > 0.0:
                raise TooManyAttempts(wait)
            own.note(now)
            self._all.note(now)
            self._by_address[address] = own
            if len(self._by_address) > _MOST_ADDRESSES:
                del self._by_address[min(self._by_address, key=lambda key: self._by_address[key].last_s)]

    def succeeded(self, client: str) -> None:
        """The attempt from that address was right."""
        address = _neighbourhood(client)
        with self._lock:
            self._by_address.pop(address, None)
            self._all.count = max(0, self._all.count - 1)
            self._known.pop(address, None)
            self._known[address] = None
            if len(self._known) > _MOST_ADDRESSES:
                del self._known[next(iter(self._known))]


def _neighbourhood(client: str) -> str:
    """An address; of version 6 the first half, because who has one has all that share it."""
    try:
        address = ipaddress.ip_address(client.partition("%")[0])
    except ValueError:
        return client[:100]
    if isinstance(address, ipaddress.IPv4Address):
        return str(address)
    if address.ipv4_mapped is not None:
        return str(address.ipv4_mapped)
    return str(ipaddress.ip_network((address, 64), strict=False))
