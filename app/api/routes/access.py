"""Logging in and out, the password, who is logged in, and tokens for programs."""

from datetime import datetime
from typing import Annotated, Literal, TypedDict

from fastapi import APIRouter, Request, Response
from pydantic import BaseModel, Field

from app.access.access import SESSION_LASTS, Kind
from app.access.state import Session, Token
from app.api.browser import browser_words
from app.api.guard import cookie_name, pass_of
from app.api.services import Served, Services
from app.errors import NotThere, PersonNeeded

router = APIRouter(prefix="/access", tags=["access"])
Password = Annotated[str, Field(max_length=1000)]


class AccessOut(BaseModel):
    """How the caller stands.

    Attributes:
        password_is_set: without one nobody logs in, and only this machine is served.
        is_let_in: whether everything else may be asked for.
        by: what lets in: that there is no password, a session or a token.
    """

    password_is_set: bool
    is_let_in: bool
    by: Kind | None


class LoginIn(BaseModel):
    """Either of the two; the key is one that the server shows as a code."""

    password: Password = ""
    key: Annotated[str, Field(max_length=200)] = ""


class PasswordIn(BaseModel):
    """The new password, and the old one where there is one."""

    old: Password = ""
    new: Password


class SessionOut(BaseModel):
    """A browser that is logged in.

    Attributes:
        browser: what it is, roughly.
        is_this: whether it is the one that asks.
    """

    id: str
    browser: str
    created: datetime
    last_seen: datetime
    expires: datetime
    is_this: bool


class TokenIn(BaseModel):
    """What the token is for."""

    name: Annotated[str, Field(min_length=1, max_length=80)]


class TokenOut(BaseModel):
    """A program that may use the server."""

    id: str
    name: str
    created: datetime
    last_used: datetime | None


class TokenMade(BaseModel):
    """A new token; the secret is shown this once.

    Attributes:
        secret: to be sent with every request, as `Authorization: Bearer SECRET`.
    """

    name: str
    secret: str


@router.get("")
def show_access(request: Request, served: Served) -> AccessOut:
    """Whether there is a password, and whether the caller is let in."""
    held = pass_of(request)
    return AccessOut(
        password_is_set=not served.access.is_open(),
        is_let_in=held is not None,
        by=held.kind if held else None,
    )


@router.post("/login")
def log_in(request: Request, response: Response, served: Served, shown: LoginIn) -> AccessOut:
    """Begin a session, which a cookie keeps for 30 days."""
    browser = browser_words(request.headers.get("user-agent", ""))
    if shown.key:
        secret = served.access.log_in_with_key(shown.key, browser)
    else:
        secret = served.access.log_in(shown.password, _address(request), browser)
    return _begun(request, response, secret)


@router.post("/logout")
def log_out(request: Request, response: Response, served: Served) -> AccessOut:
    """End the session of this browser."""
    held = pass_of(request)
    if held is not None:
        served.access.log_out(held)
    response.delete_cookie(cookie_name(request), path="/", **_flags(request))
    is_open = served.access.is_open()
    return AccessOut(password_is_set=not is_open, is_let_in=is_open, by=Kind.OPEN if is_open else None)


@router.post("/password")
def change_password(request: Request, response: Response, served: Served, wanted: PasswordIn) -> AccessOut:
    """Set another password; every session ends, and this browser gets a new one."""
    _check_person(request)
    browser = browser_words(request.headers.get("user-agent", ""))
    secret = served.access.change_password(wanted.old, wanted.new, _address(request), browser)
    return _begun(request, response, secret)


@router.get("/sessions")
def list_sessions(request: Request, served: Served) -> list[SessionOut]:
    """Browsers that are logged in, the newest first."""
    _check_person(request)
    return [_session(request, each) for each in served.access.sessions()]


@router.delete("/sessions/{session_id}")
def end_session(request: Request, served: Served, session_id: str) -> list[SessionOut]:
    """Log one out, wherever it is, and list the others."""
    _check_person(request)
    served.access.end_session(session_id)
    return [_session(request, each) for each in served.access.sessions()]


@router.get("/tokens")
def list_tokens(request: Request, served: Served) -> list[TokenOut]:
    """Tokens of programs, by name."""
    _check_person(request)
    return [_token(each) for each in served.access.tokens()]


@router.post("/tokens")
def make_token(request: Request, served: Served, wanted: TokenIn) -> TokenMade:
    """A token for a program; its secret is shown in this answer only."""
    _check_person(request)
    return TokenMade(name=wanted.name, secret=served.access.make_token(wanted.name))


@router.delete("/tokens/{token_id}")
def end_token(request: Request, served: Served, token_id: str) -> list[TokenOut]:
    """End one, and list the others."""
    _check_person(request)
    served.access.end_token(_name_of(served, token_id))
    return [_token(each) for each in served.access.tokens()]


def _check_person(request: Request) -> None:
    held = pass_of(request)
    if held is None or held.kind is Kind.TOKEN:
        raise PersonNeeded("A token does not change who may use the server.")


def _begun(request: Request, response: Response, secret: str) -> AccessOut:
    response.set_cookie(
        cookie_name(request), secret, max_age=int(SESSION_LASTS.total_seconds()), path="/", **_flags(request)
    )
    return AccessOut(password_is_set=True, is_let_in=True, by=Kind.SESSION)


class _Flags(TypedDict):
    httponly: bool
    samesite: Literal["strict"]
    secure: bool


def _flags(request: Request) -> _Flags:
    return {"httponly": True, "samesite": "strict", "secure": request.scope["scheme"] == "https"}


def _address(request: Request) -> str:
    return request.client.host if request.client else ""


def _name_of(served: Services, token_id: str) -> str:
    for each in served.access.tokens():
        if each.id == token_id:
            return each.name
    raise NotThere(f"There is no token {token_id[:60]!r}.")


def _session(request: Request, session: Session) -> SessionOut:
    held = pass_of(request)
    return SessionOut(
        id=session.id, browser=session.browser, created=session.created, last_seen=session.last_seen,
        expires=session.expires, is_this=held is not None and held.digest == session.digest,
    )  # fmt: skip


def _token(token: Token) -> TokenOut:
    return TokenOut(id=token.id, name=token.name, created=token.created, last_used=token.last_used)
