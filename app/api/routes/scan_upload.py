"""Scans from elsewhere: the file itself is the body of the request."""

from collections.abc import AsyncIterator
from pathlib import PurePosixPath
from typing import Annotated

import anyio
from fastapi import APIRouter, Query, Request
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect

from app.api.scan_models import ScanOut, shown_scan
from app.api.services import Served
from app.errors import ImportFailed
from app.library.arrival import Arrival

router = APIRouter(prefix="/scans", tags=["scans"])
_GATHERED = 1 << 20
_BODY = {
    "requestBody": {
        "required": True,
        "content": {
            kind: {"schema": {"type": "string", "format": "binary"}}
            for kind in ("application/zip", "application/octet-stream")
        },
    }
}
Title = Annotated[str, Query(max_length=200, description="By default the one it has, or the file's name.")]
File = Annotated[str, Query(max_length=255, description="What the file is called where it comes from.")]


@router.post("/upload", status_code=201, openapi_extra=_BODY)
async def upload_scan(request: Request, served: Served, title: Title = "", file: File = "") -> ScanOut:
    """Take in a zip file of one scan, or a PLY file. Nothing of it stays unless all of it is in order."""
    if request.headers.get("content-type", "").startswith("multipart/"):
        raise ImportFailed("The upload is a form.", "Send the file itself as the body of the request.")
    called = PurePosixPath(file.replace("\\", "/")).name or "upload"
    promised = request.headers.get("content-length", "")
    arrival = Arrival(served.library, int(promised) if promised.isdecimal() else None)
    try:
        await run_in_threadpool(arrival.__enter__)
        async for data in _gathered(request):
            await run_in_threadpool(arrival.write, data)
        item = await run_in_threadpool(arrival.take_in, title, called)
    finally:
        with anyio.CancelScope(shield=True):
            await run_in_threadpool(arrival.__exit__)
    return shown_scan(item)


async def _gathered(request: Request) -> AsyncIterator[bytes]:
    """The body in pieces that are worth a trip to the disk."""
    waiting = bytearray()
    try:
        async for part in request.stream():
            waiting += part
            if len(waiting) >= _GATHERED:
                yield bytes(waiting)
                waiting.clear()
    except ClientDisconnect as error:
        raise ImportFailed("The upload broke off before its end.", "Upload it again.") from error
    yield bytes(waiting)
