"""The library of scans."""

from typing import Annotated

from fastapi import APIRouter
from pydantic import BaseModel, Field

from app.api.scan_models import ScanOut, shown_scan
from app.api.services import Served
from app.library.log import read_log

router = APIRouter(prefix="/scans", tags=["scans"])


class Words(BaseModel):
    """What people call a scan and say of it; what is absent stays."""

    title: Annotated[str, Field(min_length=1, max_length=200)] | None = None
    note: Annotated[str, Field(max_length=10_000)] | None = None


class ThrownAway(BaseModel):
    """Where a deleted scan is, until the bin is emptied."""

    key: str


class FreedOut(BaseModel):
    """What erasing something gave back."""

    freed_bytes: int


@router.get("")
def list_scans(served: Served) -> list[ScanOut]:
    """All scans, newest first."""
    return [shown_scan(item) for item in served.library.scans()]


@router.get("/{name}")
def show_scan(served: Served, name: str) -> ScanOut:
    """One scan."""
    return shown_scan(served.library.scan(name))


@router.patch("/{name}")
def describe_scan(served: Served, name: str, words: Words) -> ScanOut:
    """Give it another title or note."""
    if words.title is not None:
        served.library.rename(name, words.title)
    if words.note is not None:
        served.library.note(name, words.note)
    return shown_scan(served.library.scan(name))


@router.delete("/{name}")
def delete_scan(served: Served, name: str) -> ThrownAway:
    """Move it to the bin."""
    return ThrownAway(key=served.library.delete(name).key)


@router.get("/{name}/log")
def show_scan_log(served: Served, name: str) -> list[str]:
    """What was done with it, oldest line first; each begins with its time."""
    return list(read_log(served.library.folder_of(name)))


@router.delete("/{name}/clouds/{cloud:path}")
def erase_cloud(served: Served, name: str, cloud: str) -> FreedOut:
    """Erase one cloud for good; the others and the recording stay."""
    return FreedOut(freed_bytes=served.library.erase_cloud(name, cloud))
