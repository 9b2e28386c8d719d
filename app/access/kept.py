"""The file of `access.json` as several programs share it: looked at often, changed by one at a time."""

import os
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from app.access.state import AccessState, Session, Stamp, Token, load_state, save_state, stamp_of
from app.errors import AccessFileError, NoPassword, OutputError
from app.files import make_folder, reason
from app.locks import lock

_LOOK_AGAIN_S = 1.0
_PATIENCE_S = 10.0


@dataclass(frozen=True, slots=True)
class Seen:
    """What the file said when it was looked at.

    Attributes:
        state: nothing where there is no file, or where there is a problem.
        sessions, tokens: of the state, by their digests.
        problem: the file is there but cannot be understood.
    """

    stamp: Stamp | None = None
    state: AccessState | None = None
    sessions: Mapping[str, Session] = field(default_factory=dict)
    tokens: Mapping[str, Token] = field(default_factory=dict)
    problem: AccessFileError | None = None


@dataclass(slots=True)
class Change:
    """What the file is to say; set `state`."""

    state: AccessState | None

    def needed(self) -> AccessState:
        """The state, where there must be one.

        Raises:
            NoPassword: there is none.
        """
        if self.state is None:
            raise NoPassword
        return self.state


class KeptAccess:
    """One file, wherever it is at the moment: it may be missing, changed by others, damaged."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._seen = Seen()
        self._next_look_s = 0.0
        self._changing = threading.Lock()

    def look(self, *, at_once: bool = False) -> Seen:
        """What the file says; looked at once a second at most, unless it matters."""
        now_s = time.monotonic()
        if at_once or now_s >= self._next_look_s:
            self._seen = _looked(self.path, self._seen)
            self._next_look_s = now_s + _LOOK_AGAIN_S
        return self._seen

    def state(self, *, at_once: bool = False) -> AccessState | None:
        """Nothing where there is no file.

        Raises:
            AccessFileError: it cannot be understood.
        """
        seen = self.look(at_once=at_once)
        if seen.problem is not None:
            raise AccessFileError(seen.problem.where, seen.problem.problem)
        return seen.state

    @contextmanager
    def changed(self) -> Iterator[Change]:
        """Change what the file says, and nobody else meanwhile, in this program or another.

        Raises:
            AccessFileError, OutputError: it cannot be understood, or not be written.
        """
        with self._alone():
            change = Change(self.state(at_once=True))
            yield change
            if change.state is not None:
                save_state(self.path, change.state.without_expired())
            self.look(at_once=True)

    def forget(self) -> None:
        """Take the file away, whatever is in it.

        Raises:
            AccessFileError, OutputError: it cannot be done.
        """
        with self._alone():
            save_state(self.path, None)
            self.look(at_once=True)

    @contextmanager
    def _alone(self) -> Iterator[None]:
        make_folder(self.path.parent)
        beside = self.path.with_name(f".{self.path.name}.lock")
        try:
            handle = os.open(beside, os.O_RDWR | os.O_CREAT, 0o600)
        except OSError as error:
            raise OutputError(str(beside), reason(error)) from error
        with self._changing, os.fdopen(handle, "rb") as file:
            if not lock(file, _PATIENCE_S):
                raise OutputError(str(self.path), "another program is changing it", "Try again.")
            yield


def _looked(path: Path, before: Seen) -> Seen:
    try:
        stamp = stamp_of(path)
        if stamp == before.stamp and before.problem is None:
            return before
        state = load_state(path)
    except AccessFileError as error:
        return Seen(problem=error)
    if state is None:
        return Seen()
    sessions = {each.digest: each for each in state.sessions}
    return Seen(stamp, state, sessions, {each.digest: each for each in state.tokens})
