"""The login page: the one page that strangers are shown, in their language."""

import json
from functools import cache
from html import escape
from http import HTTPStatus
from pathlib import Path
from string import Template

from starlette.requests import Request
from starlette.responses import FileResponse, HTMLResponse, PlainTextResponse, RedirectResponse, Response
from starlette.routing import BaseRoute, Route

from app.api.guard import HEALTH, LOGIN, is_local_path
from app.api.headers import CONTENT_POLICY

_FILES = Path(__file__).parent / "login"
# Nobody may put it into a frame and have people type into that.
_POLICY = CONTENT_POLICY.replace("frame-ancestors 'self'", "frame-ancestors 'none'")
_HEADERS = {
    "Content-Security-Policy": _POLICY,
    "X-Frame-Options": "DENY",
    "Cache-Control": "no-store",
    "Vary": "Accept-Language",
}


def login_routes() -> list[BaseRoute]:
    """Routes for the page, its two files, and for those who only ask whether the server is there."""
    return [
        Route(LOGIN, _page, methods=["GET"], include_in_schema=False),
        Route(f"{LOGIN}/login.css", _style, methods=["GET"], include_in_schema=False),
        Route(f"{LOGIN}/login.js", _script, methods=["GET"], include_in_schema=False),
        Route(HEALTH, _health, methods=["GET"], include_in_schema=False),
    ]


def language_of(accepted: str) -> str:
    """The language of the page that a browser likes best, after its `Accept-Language`."""
    liked = {"en": 0.0, "de": 0.0}
    for entry in accepted.split(",")[:50]:
        tag, _, rest = entry.strip().partition(";")
        language = tag.strip().lower().partition("-")[0]
        try:
            weight = float(rest.strip().removeprefix("q=")) if rest else 1.0
        except ValueError:
            weight = 0.0
        if language in liked:
            liked[language] = max(liked[language], weight)
    return max(liked, key=lambda language: liked[language])


def _page(request: Request) -> Response:
    if not is_local_path(request.query_params.get("next", "/")):
        return RedirectResponse(LOGIN, HTTPStatus.SEE_OTHER, _HEADERS)
    return HTMLResponse(_html(language_of(request.headers.get("accept-language", ""))), headers=_HEADERS)


def _style(request: Request) -> Response:
    return FileResponse(_FILES / "login.css", headers={"Cache-Control": "no-cache"}, media_type="text/css")


def _script(request: Request) -> Response:
    kept = {"Cache-Control": "no-cache"}
    return FileResponse(_FILES / "login.js", headers=kept, media_type="text/javascript")


async def _health(request: Request) -> Response:
    return PlainTextResponse("ok", headers={"Cache-Control": "no-store"})


@cache
def _html(language: str) -> str:
    words = json.loads((_FILES / "words.json").read_text("utf-8"))[language]
    sentences = words.pop("sentences").items()
    filled = {name: escape(text) for name, text in words.items()}
    filled["sentences"] = " ".join(f'data-{kind}="{escape(text)}"' for kind, text in sentences)
    return Template((_FILES / "page.html").read_text("utf-8")).substitute(filled, language=language)
