"""One-time keys: for the code that somebody scans with a phone, instead of typing a password on it."""

import secrets
import threading
import time
from collections.abc import Callable
from hashlib import sha256

LASTS_S = 600.0
_MOST = 20


class OneTimeKeys:
    """Those that are out and not used yet; they end with the program."""

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        self._now_s = now_s
        self._lock = threading.Lock()
        self._ends_s: dict[str, float] = {}

    def make(self) -> str:
        """A new one; of very many, the oldest stops counting."""
        key = secrets.token_urlsafe(24)
        with self._lock:
            self._ends_s[digest_of(key)] = self._now_s() + LASTS_S
            while len(self._ends_s) > _MOST:
                del self._ends_s[next(iter(self._ends_s))]
        return key

    def use(self, key: str) -> bool:
        """Whether it counts; it does not a second time."""
        with self._lock:
            return self._ends_s.pop(digest_of(key), 0.0) > self._now_s()

    def forget(self) -> None:
        """None counts any more."""
        with self._lock:
            self._ends_s.clear()


def digest_of(secret: str) -> str:
    """By which a secret is known without being kept."""
    return sha256(secret.encode("utf-8", "surrogatepass")).hexdigest()
