"""Access: the one thing that knows who may use the server."""

import logging
import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from enum import StrEnum
from pathlib import Path
from typing import Self

from app.access.attempts import Attempts
from app.access.kept import KeptAccess
from app.access.keys import OneTimeKeys, digest_of
from app.access.password import LONGEST, Checker, Hashing, check_fit, made_password
from app.access.state import FILE, MOST_TOKENS, AccessState, Session, Token
from app.errors import KeyRefused, NoPassword, NotThere, OptionError, ScannerError, WrongPassword

SESSION_LASTS = timedelta(days=30)
_SAVE_SEEN_S = 600.0
_TOKEN_MARK = "turnscan_"
_log = logging.getLogger(__name__)


class Kind(StrEnum):
    """By what somebody is let in."""

    OPEN = "open"
    """There is no password."""
    SESSION = "session"
    TOKEN = "token"


@dataclass(frozen=True, slots=True)
class Pass:
    """Somebody who has been let in; ask `Access.holds` whether it still counts.

    Attributes:
        digest: of the session or the token; empty where everybody is let in.
    """

    kind: Kind
    digest: str = ""


class Access:
    """The password of a served folder, who is logged in, and the tokens; kept in its `access.json`.

    The rule of the server: without a password it answers this machine only, and nobody logs in; with one it
    answers under every name and address, and asks everybody. Another program may change the file, as
    `turnscan password` does: what it says is noticed within a second. Every method may be called from any
    thread; those that check a password take a while, and are not for the event loop.
    """

    def __init__(
        self, folder: Path, *, hashing: Hashing | None = None, attempts: Attempts | None = None
    ) -> None:
        self._kept = KeptAccess(folder / FILE)
        self._hashing, self._attempts = hashing or Hashing(), attempts or Attempts()
        self._checker = Checker()
        self._keys = OneTimeKeys()
        self._seen: dict[str, datetime] = {}
        self._saved_s = time.monotonic()

    @classmethod
    def open(cls, folder: Path, *, hashing: Hashing | None = None, attempts: Attempts | None = None) -> Self:
        """That of a folder; it need not be there before the first password is set.

        Raises:
            AccessFileError: there is a file that cannot be understood. Nobody must be let in then.
        """
        access = cls(folder, hashing=hashing, attempts=attempts)
        access._kept.state(at_once=True)
        return access

    @property
    def has_password(self) -> bool:
        """Whether one is set.

        Raises:
            AccessFileError: the file has been damaged since.
        """
        return self._kept.state(at_once=True) is not None

    def make_password(self) -> str:
        """Set a strong one, and return it: it is not kept anywhere as text."""
        password = made_password()
        self.set_password(password)
        return password

    def set_password(self, password: str) -> None:
        """Set or change it; every session ends, tokens stay.

        Raises:
            PasswordUnfit: it protects too little.
            AccessFileError, OutputError: the file is damaged or cannot be written.
        """
        check_fit(password)
        hashed = self._hashing.hash(password)
        with self._kept.changed() as change:
            tokens = change.state.tokens if change.state else ()
            change.state = AccessState(password=hashed, tokens=tokens)
        self._keys.forget()

    def forget_password(self) -> None:
        """Take the password, all sessions and all tokens away; also the way out of a damaged file.

        Raises:
            AccessFileError: the file cannot be removed.
        """
        self._kept.forget()
        self._keys.forget()

    def one_time_key(self) -> str:
        """Logs in one browser within ten minutes, as `/login#key=KEY`; this object alone knows it."""
        return self._keys.make()

    def log_in(self, password: str, client: str, browser: str) -> str:
        """Begin a session, and return its secret for the browser to keep.

        Args:
            client: address of the caller, by which attempts are counted.
            browser: what it is, in a few words.

        Raises:
            WrongPassword, TooManyAttempts: as they say.
            NoPassword: none is set.
            AccessFileError, OutputError: the file is damaged or cannot be written.
        """
        self._check(password, client)
        return self._begun(browser)

    def log_in_with_key(self, key: str, browser: str) -> str:
        """The same with a one-time key.

        Raises:
            KeyRefused: it was never made, is too old or has been used.
        """
        if not self._keys.use(key):
            raise KeyRefused
        return self._begun(browser)

    def change_password(self, old: str, new: str, client: str, browser: str) -> str:
        """Set another password, or the first, when `old` is not looked at; return a new session's secret.

        Raises:
            as `log_in` and `set_password` do.
        """
        check_fit(new)
        if self.has_password:
            self._check(old, client)
        self.set_password(new)
        return self._begun(browser)

    def let_in_by_cookie(self, secret: str) -> Pass | None:
        """Who has that secret from `log_in`."""
        session = self._kept.look().sessions.get(digest := digest_of(secret))
        return self._met(Pass(Kind.SESSION, digest)) if session and session.expires > _now() else None

    def let_in_by_token(self, secret: str) -> Pass | None:
        """Who has that secret from `make_token`."""
        token = self._kept.look().tokens.get(digest := digest_of(secret))
        return self._met(Pass(Kind.TOKEN, digest)) if token else None

    @property
    def is_understood(self) -> bool:
        """Whether the file is whole, or there is none."""
        return self._kept.look().problem is None

    def is_open(self) -> bool:
        """Whether no password is set, as was true at most a second ago.

        Raises:
            AccessFileError: the file is damaged.
        """
        return self._kept.state() is None

    def holds(self, held: Pass) -> bool:
        """Whether who was let in would be let in still."""
        known = self._kept.look()
        if known.problem is not None:
            return False
        match held.kind:
            case Kind.OPEN:
                return known.state is None
            case Kind.SESSION:
                session = known.sessions.get(held.digest)
                return session is not None and session.expires > _now()
            case Kind.TOKEN:
                return held.digest in known.tokens

    def sessions(self) -> list[Session]:
        """Those that count, the newest first."""
        found = [each for each in self._kept.look().sessions.values() if each.expires > _now()]
        found = [
            each.model_copy(update={"last_seen": self._seen.get(each.digest, each.last_seen)})
            for each in found
        ]
        return sorted(found, key=lambda each: each.created, reverse=True)

    def end_session(self, session_id: str) -> None:
        """Log that browser out.

        Raises:
            NotThere: there is no such session.
        """
        self._end_sessions(lambda each: each.id == session_id, f"There is no session {session_id[:60]!r}.")

    def log_out(self, held: Pass) -> None:
        """End one's own session; nothing happens to others who were let in."""
        if held.kind is Kind.SESSION and self.holds(held):
            self._end_sessions(lambda each: each.digest == held.digest, "The session has ended already.")

    def tokens(self) -> list[Token]:
        """All of them, by name."""
        found = self._kept.look(at_once=True).tokens.values()
        used = [
            each.model_copy(update={"last_used": self._seen.get(each.digest, each.last_used)})
            for each in found
        ]
        return sorted(used, key=lambda each: each.name)

    def make_token(self, name: str) -> str:
        """A secret for a program; it is not kept anywhere as text.

        Raises:
            OptionError: the name cannot be used, or is taken.
            NoPassword: without one there is nothing to protect.
        """
        name = " ".join(name.split())
        if not 0 < len(name) <= 80 or not name.isprintable():
            raise OptionError("The name of the token cannot be used.", "Give 1 to 80 letters.")
        secret = _TOKEN_MARK + secrets.token_urlsafe(32)
        with self._kept.changed() as change:
            state = change.needed()
            if any(each.name == name for each in state.tokens):
                raise OptionError(
                    f"There is a token called {name!r} already.", "Choose another name, or end it first."
                )
            if len(state.tokens) >= MOST_TOKENS:
                raise OptionError(f"There are {MOST_TOKENS} tokens already.", "End one that nobody uses.")
            made = Token(digest=digest_of(secret), created=_now(), name=name)
            change.state = state.model_copy(update={"tokens": (*state.tokens, made)})
        return secret

    def end_token(self, name: str) -> None:
        """From now on it opens nothing.

        Raises:
            NotThere: no token has that name.
        """
        with self._kept.changed() as change:
            state = change.needed()
            kept = tuple(each for each in state.tokens if each.name != name)
            if len(kept) == len(state.tokens):
                raise NotThere(f"There is no token called {name[:80]!r}.")
            change.state = state.model_copy(update={"tokens": kept})

    @property
    def has_news(self) -> bool:
        """Whether it is time for `save_seen`."""
        return bool(self._seen) and time.monotonic() - self._saved_s > _SAVE_SEEN_S

    def save_seen(self) -> None:
        """Write down when sessions and tokens were used last; where that fails, only the log says so."""
        self._saved_s = time.monotonic()
        if not self._seen:
            return
        try:
            with self._kept.changed() as change:
                if change.state is not None:
                    change.state = self._with_seen(change.state)
        except ScannerError as error:
            _log.warning("when somebody was here last is not written down: %s", error.message)

    def _check(self, password: str, client: str) -> None:
        with self._checker.in_line():
            state = self._kept.state(at_once=True)
            if state is None:
                raise NoPassword
            self._attempts.begin(client)
            if len(password) > LONGEST or not self._checker.is_right(password, state.password):
                raise WrongPassword
            self._attempts.succeeded(client)

    def _begun(self, browser: str) -> str:
        secret, now = secrets.token_urlsafe(32), _now()
        begun = Session(
            digest=digest_of(secret), created=now, last_seen=now, expires=now + SESSION_LASTS,
            browser=browser[:80] or "unknown",
        )  # fmt: skip
        with self._kept.changed() as change:
            state = change.needed()
            change.state = state.model_copy(update={"sessions": (*state.sessions, begun)})
        return secret

    def _end_sessions(self, is_meant: Callable[[Session], bool], otherwise: str) -> None:
        with self._kept.changed() as change:
            state = change.needed()
            kept = tuple(each for each in state.sessions if not is_meant(each))
            if len(kept) == len(state.sessions):
                raise NotThere(otherwise)
            change.state = state.model_copy(update={"sessions": kept})

    def _met(self, who: Pass) -> Pass:
        self._seen[who.digest] = _now()
        return who

    def _with_seen(self, state: AccessState) -> AccessState:
        seen, self._seen = self._seen, {}
        sessions = (
            each.model_copy(update={"last_seen": seen.get(each.digest, each.last_seen)})
            for each in state.sessions
        )
        tokens = (
            each.model_copy(update={"last_used": seen.get(each.digest, each.last_used)})
            for each in state.tokens
        )
        return state.model_copy(update={"sessions": tuple(sessions), "tokens": tuple(tokens)})


def _now() -> datetime:
    return datetime.now(UTC)
