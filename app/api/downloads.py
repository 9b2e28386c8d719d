"""Files on their way out: names that suit every system, caches that ask, streams that let go."""

import hashlib
import logging
import os
import unicodedata
from collections.abc import Callable, Generator
from email.utils import formatdate
from http import HTTPStatus
from pathlib import Path
from urllib.parse import quote

from fastapi.responses import FileResponse, Response, StreamingResponse
from starlette.requests import Request
from starlette.types import Receive, Scope, Send

from app.errors import NotThere, ScannerError

_ASK_FIRST = "private, no-cache"
_LONGEST = 100
_log = logging.getLogger(__name__)


def file_answer(request: Request, path: Path, media_type: str, disposition: str = "inline") -> Response:
    """A file, a part of it, or the word that the client has it already.

    Raises:
        NotThere: it is gone.
    """
    facts = _facts(path)
    headers = {
        "ETag": _tag(facts),
        "Last-Modified": formatdate(facts.st_mtime, usegmt=True),
        "Cache-Control": _ASK_FIRST,
        "Content-Disposition": disposition,
    }
    if _has_it(request, headers["ETag"]):
        return Response(status_code=HTTPStatus.NOT_MODIFIED, headers=headers)
    return FileResponse(path, headers=headers, media_type=media_type, stat_result=facts)


def made_answer(
    request: Request, path: Path, make: Callable[[], bytes], media_type: str, *options: object
) -> Response:
    """Something small that is made of a file, or the word that the client has it already.

    Args:
        request: what was asked.
        path: the file; when it changes, what is made of it has changed.
        make: called where the client has it not.
        media_type: of what is made.
        options: what else it depends on.

    Raises:
        NotThere: the file is gone.
    """
    headers = {"ETag": _tag(_facts(path), *options), "Cache-Control": _ASK_FIRST}
    if _has_it(request, headers["ETag"]):
        return Response(status_code=HTTPStatus.NOT_MODIFIED, headers=headers)
    return Response(make(), headers=headers, media_type=media_type)


def attachment(title: str, ending: str) -> str:
    """A `Content-Disposition` that saves a file under a title (RFC 6266), safe on every system."""
    kept = "".join(
        letter if letter.isprintable() and letter not in '/\\:*?"<>|%' else " " for letter in title
    )
    name = (" ".join(kept.split())[:_LONGEST].strip(". ") or "scan") + ending
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode().strip()
    plain = plain if plain.removesuffix(ending).strip(". ") else f"scan{ending}"
    same = f'attachment; filename="{plain}"'
    return same if plain == name else f"{same}; filename*=UTF-8''{quote(name.encode('utf-8', 'replace'))}"


class PartsResponse(StreamingResponse):
    """A body made while it is sent; whatever ends the sending, the maker is closed.

    Args:
        parts: makes the body; never asked where only the head is wanted.
        length: of all of it, where known.
    """

    def __init__(
        self, parts: Generator[bytes], media_type: str, headers: dict[str, str], length: int | None = None
    ) -> None:
        if length is not None:
            headers = headers | {"Content-Length": str(length)}
        super().__init__(parts, headers=headers, media_type=media_type)
        self._parts = parts

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        try:
            if scope["method"] == "HEAD":
                head = {"type": "http.response.start", "status": 200, "headers": self.raw_headers}
                await send(head)
                await send({"type": "http.response.body", "body": b""})
            else:
                await super().__call__(scope, receive, send)
        except ScannerError as error:
            # The head has gone out: all there is left to do is to break off, which the client sees.
            _log.warning("A download ended early. %s", error.message)
        finally:
            self._parts.close()


def _has_it(request: Request, tag: str) -> bool:
    given = [each.strip().removeprefix("W/") for each in request.headers.get("if-none-match", "").split(",")]
    return tag in given or given == ["*"]


def _facts(path: Path) -> os.stat_result:
    try:
        return path.stat()
    except OSError as error:
        raise NotThere(f"{path.name} is not there any more.", "Ask for the scan again.") from error


def _tag(facts: os.stat_result, *options: object) -> str:
    text = repr((facts.st_mtime_ns, facts.st_size, facts.st_ino, *options))
    return f'"{hashlib.blake2b(text.encode(), digest_size=12).hexdigest()}"'
