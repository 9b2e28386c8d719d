"""`access.json`: the password's hash, sessions and tokens, as they are on disk."""

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Literal, Self

from argon2 import extract_parameters
from argon2.exceptions import InvalidHashError
from pydantic import AfterValidator, AwareDatetime, BaseModel, ConfigDict, Field, ValidationError

from app.errors import AccessFileError
from app.files import reason, write_whole

FILE = "access.json"
MOST_SESSIONS, MOST_TOKENS = 100, 100
_LARGEST_BYTES = 1_000_000
_OWNER_ONLY = 0o600


def _checked_hash(text: str) -> str:
    try:
        extract_parameters(text)
    except InvalidHashError as error:
        raise ValueError("is no hash of argon2") from error
    return text


Digest = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
Words = Annotated[str, Field(min_length=1, max_length=80)]


class _Entry(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")

    digest: Digest
    created: AwareDatetime

    @property
    def id(self) -> str:
        """Names the entry to people and programs; does not open anything."""
        return self.digest[:12]


class Session(_Entry):
    """A browser that is logged in.

    Attributes:
        digest: SHA-256 of the secret that the browser keeps.
        expires: from then on it is as if it were not there.
        browser: what it is, roughly: `Firefox on Android`.
    """

    last_seen: AwareDatetime
    expires: AwareDatetime
    browser: Words


class Token(_Entry):
    """A program that may use the server.

    Attributes:
        digest: SHA-256 of the secret that the program keeps.
        name: no other token has it.
        last_used: nothing where it never was.
    """

    name: Words
    last_used: AwareDatetime | None = None


class AccessState(BaseModel):
    """Everything; there is no file where there is no password."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    version: Literal[1] = 1
    password: Annotated[str, Field(max_length=500), AfterValidator(_checked_hash)]
    sessions: tuple[Session, ...] = ()
    tokens: tuple[Token, ...] = ()

    def without_expired(self) -> Self:
        """With the sessions that still count: those begun last, as many as are kept."""
        now = datetime.now(UTC)
        # In the order in which they were begun, whatever the clock said.
        valid = [each for each in self.sessions if each.expires > now]
        return self.model_copy(update={"sessions": tuple(valid[-MOST_SESSIONS:])})


@dataclass(frozen=True, slots=True)
class Stamp:
    """What tells one version of the file from the next; each is a new file put in the old one's place."""

    inode: int
    modified_ns: int
    size: int


def stamp_of(path: Path) -> Stamp | None:
    """Nothing where there is no file.

    Raises:
        AccessFileError: the system does not tell.
    """
    try:
        facts = path.stat()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise AccessFileError(path.name, reason(error)) from error
    return Stamp(facts.st_ino, facts.st_mtime_ns, facts.st_size)


def load_state(path: Path) -> AccessState | None:
    """Nothing where there is no file; a file that cannot be understood is an error, never nothing.

    Raises:
        AccessFileError: it cannot be read, or is damaged.
    """
    try:
        with path.open("rb") as file:
            data = file.read(_LARGEST_BYTES + 1)
        if len(data) > _LARGEST_BYTES:
            raise AccessFileError(path.name, "is too large")
        return AccessState.model_validate_json(data)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise AccessFileError(path.name, reason(error)) from error
    except ValidationError as error:
        first = error.errors(include_input=False, include_url=False)[0]
        place = ".".join(str(part) for part in first["loc"])
        raise AccessFileError(path.name, f"is damaged ({place or 'the whole'}: {first['msg']})") from error


def save_state(path: Path, state: AccessState | None) -> None:
    """Write it, readable for its owner only; without a state, take the file away.

    Raises:
        OutputError, AccessFileError: it cannot be done.
    """
    if state is not None:
        write_whole(path, state.model_dump_json(indent=2).encode() + b"\n", mode=_OWNER_ONLY)
        return
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise AccessFileError(path.name, reason(error)) from error
