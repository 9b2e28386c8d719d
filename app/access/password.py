"""Passwords: made, judged, hashed with argon2id and checked, one at a time."""

import secrets
import threading
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final

from argon2 import PasswordHasher
from argon2.exceptions import Argon2Error

from app.errors import PasswordUnfit, TooManyAttempts

SHORTEST, LONGEST = 8, 200
# Small letters that nobody takes for another one or for a digit.
_LETTERS: Final = "abcdefghjkmnpqrstuvwxyz"
_GROUPS, _GROUP = 4, 4
_MOST_WAITING = 4


@dataclass(frozen=True, slots=True)
class Hashing:
    """What one attempt costs, the owner's as well as a thief's.

    Attributes:
        memory_kib: that it fills.
        passes: over that memory.
    """

    memory_kib: int = 19_456
    passes: int = 2

    def hash(self, password: str) -> str:
        hasher = PasswordHasher(time_cost=self.passes, memory_cost=self.memory_kib, parallelism=1)
        return hasher.hash(_canonical(password))


class Checker:
    """Compares passwords with hashes: one at a time, on one core, and with few in line."""

    def __init__(self) -> None:
        self._line = threading.BoundedSemaphore(_MOST_WAITING)
        self._turn = threading.Lock()

    @contextmanager
    def in_line(self) -> Iterator[None]:
        """A place in the line; without one nothing may be compared.

        Raises:
            TooManyAttempts: it is full.
        """
        if not self._line.acquire(blocking=False):
            raise TooManyAttempts(1.0)
        try:
            with self._turn:
                yield
        finally:
            self._line.release()

    def is_right(self, password: str, hashed: str) -> bool:
        try:
            return PasswordHasher().verify(hashed, _canonical(password))
        except Argon2Error:
            return False


def made_password() -> str:
    """Four groups of four letters, 72 bits: easy to read out and to type."""
    return "-".join("".join(secrets.choice(_LETTERS) for _ in range(_GROUP)) for _ in range(_GROUPS))


def check_fit(password: str) -> None:
    """Complain about a password that does not protect.

    Raises:
        PasswordUnfit: it is too short, too long, no text, or one letter over and over.
    """
    if not SHORTEST <= len(password) <= LONGEST:
        raise PasswordUnfit(f"A password has {SHORTEST} to {LONGEST} characters.")
    if not password.isprintable():
        raise PasswordUnfit("The password has characters that cannot be typed.")
    if len(set(password)) < SHORTEST // 2:
        raise PasswordUnfit("The password has too few different characters.")


def _canonical(password: str) -> str:
    """One spelling for what people type alike: made passwords with capitals, with spaces, without hyphens."""
    text = unicodedata.normalize("NFC", password)
    bare = text.replace("-", "").replace(" ", "").lower()
    is_made = len(bare) == _GROUPS * _GROUP and set(bare) <= set(_LETTERS)
    return bare if is_made else text
