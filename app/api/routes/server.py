"""The server itself: what it is, where it is reached, and a code that lets a phone in."""

import platform
from importlib.metadata import version
from typing import Annotated

import segno
from fastapi import APIRouter, Request
from pydantic import BaseModel, Field

from app.access.access import Kind
from app.access.keys import LASTS_S
from app.api.guard import pass_of
from app.api.services import Served, Services
from app.errors import NoPassword, NotThere, PersonNeeded

router = APIRouter(prefix="/server", tags=["server"])


class ServerOut(BaseModel):
    """What the server is.

    Attributes:
        addresses: for other machines, the one to recommend first; none where they cannot reach it.
        is_local: whether it was started for this machine only.
        folder: holds scans, calibrations and settings.
    """

    version: str
    python: str
    system: str
    folder: str
    addresses: list[str]
    is_local: bool
    is_encrypted: bool


class CodeIn(BaseModel):
    """Where the phone shall go; the recommended address where none is named."""

    address: Annotated[str, Field(max_length=300)] = ""


class CodeOut(BaseModel):
    """A link that logs in one browser, and the same as a QR code.

    Attributes:
        link: with the key behind `#`, which browsers send to no server.
        rows: of the code, `1` where it is dark; without the margin of four that readers need.
        lasts_s: for so many seconds.
    """

    link: str
    rows: list[str]
    lasts_s: float


@router.get("")
def show_server(request: Request, served: Served) -> ServerOut:
    """Version, folder, and addresses for other machines."""
    return ServerOut(
        version=version("turnscan"),
        python=platform.python_version(),
        system=f"{platform.system()} {platform.machine()}",
        folder=served.about.folder,
        addresses=_addresses(request, served),
        is_local=served.about.is_local,
        is_encrypted=request.scope["scheme"] == "https",
    )


@router.post("/phone-code")
def make_phone_code(request: Request, served: Served, wanted: CodeIn) -> CodeOut:
    """A code for a phone: it is logged in by it, once, within ten minutes."""
    held = pass_of(request)
    if held is None or held.kind is Kind.TOKEN:
        raise PersonNeeded("A token lets nobody in.")
    if not served.access.has_password:
        raise NoPassword
    there = _addresses(request, served)
    address = wanted.address or (there[0] if there else "")
    if address not in there:
        raise NotThere(
            f"Other machines do not reach this server at {address[:80]!r}.",
            "Start it with `turnscan serve --host 0.0.0.0`." if not there else "Choose one that is listed.",
        )
    link = f"{address}/login#key={served.access.one_time_key()}"
    matrix = segno.make_qr(link, error="m").matrix
    rows = ["".join("1" if each else "0" for each in row) for row in matrix]
    return CodeOut(link=link, rows=rows, lasts_s=LASTS_S)


def _addresses(request: Request, served: Services) -> list[str]:
    server = request.scope.get("server")
    port = f":{server[1]}" if server and server[1] else ""
    hosts = [f"[{host}]" if ":" in host else host for host in served.about.hosts()]
    return [f"{request.scope['scheme']}://{host}{port}" for host in hosts]
