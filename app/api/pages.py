"""The pages as they were built from `web/`: one document for all places, and the files it asks for."""

from mimetypes import guess_type
from pathlib import Path

from starlette.requests import Request
from starlette.responses import FileResponse, Response
from starlette.routing import BaseRoute, Route

import app

BUILT = Path(app.__file__).parent / "_web"
PLACES = ("scan", "adjust", "calibrate", "library", "settings", "setup")
"""Paths that the page itself tells apart; each may have more behind it."""

_NOTICE = Path(__file__).parent / "pages_missing.html"
_POLICY = "; ".join(
    (
        "default-src 'self'",
        "img-src 'self' blob: data:",
        "object-src 'none'",
        "frame-ancestors 'none'",
        "base-uri 'none'",
        "form-action 'self'",
    )
)
_NOT_KEPT, _FOR_EVER = "no-cache", "public, max-age=31536000, immutable"
_PACKED = (("br", ".br"), ("gzip", ".gz"))
_TYPES = {".webmanifest": "application/manifest+json", ".js": "text/javascript", ".svg": "image/svg+xml"}


def page_routes(folder: Path = BUILT) -> list[BaseRoute]:
    """Routes for `/`, the places and the files; a notice where the pages were not built.

    Args:
        folder: what the build made; looked into at every request, so a build may come later.
    """

    def page(request: Request) -> Response:
        index = folder / "index.html"
        headers = {"Content-Security-Policy": _POLICY, "Cache-Control": _NOT_KEPT}
        if not index.is_file():
            return FileResponse(_NOTICE, 503, headers, "text/html")
        return _packed(request, index, headers)

    def file(request: Request) -> Response:
        path = (folder / request.url.path.lstrip("/")).resolve()
        if not path.is_relative_to(folder.resolve()) or not path.is_file():
            return Response("Not found.", 404, media_type="text/plain")
        is_named_by_content = path.parent.name == "assets"
        return _packed(request, path, {"Cache-Control": _FOR_EVER if is_named_by_content else _NOT_KEPT})

    documents = ["/", *(f"/{place}" for place in PLACES), *(f"/{place}/{{rest:path}}" for place in PLACES)]
    files = ["/assets/{name}", "/icons/{name}", "/manifest.webmanifest", "/favicon.svg"]
    return [
        *(Route(path, page, methods=["GET"], include_in_schema=False) for path in documents),
        *(Route(path, file, methods=["GET"], include_in_schema=False) for path in files),
    ]


def _packed(request: Request, path: Path, headers: dict[str, str]) -> Response:
    """A file, in the smallest form that was made of it and that the browser takes."""
    media_type = _TYPES.get(path.suffix) or guess_type(path.name)[0] or "application/octet-stream"
    accepted = {each.split(";")[0].strip() for each in request.headers.get("accept-encoding", "").split(",")}
    headers = headers | {"Vary": "Accept-Encoding"}
    for name, ending in _PACKED:
        packed = path.with_name(path.name + ending)
        if name in accepted and packed.is_file():
            return FileResponse(packed, headers=headers | {"Content-Encoding": name}, media_type=media_type)
    return FileResponse(path, headers=headers, media_type=media_type)
