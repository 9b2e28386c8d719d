"""Scans that were thrown away, and the room on the disk."""

from datetime import datetime
from typing import Annotated

from fastapi import APIRouter, Query
from pydantic import BaseModel

from app.api.scan_models import ScanOut, shown_scan
from app.api.services import Served

router = APIRouter(prefix="/scans", tags=["scans"])
Frees = Annotated[
    int, Query(ge=0, description="How many bytes the person was told that this frees; it must be so.")
]


class BinOut(BaseModel):
    """A scan in the bin.

    Attributes:
        key: what it is called in the bin.
        name: what its folder was called.
        frees_bytes: what erasing it gives back.
    """

    key: str
    name: str
    title: str
    created: datetime
    deleted: datetime
    pictures: int
    points: int
    frees_bytes: int


class ErasedOut(BaseModel):
    """What was erased for good."""

    scans: int
    freed_bytes: int


class SpaceOut(BaseModel):
    """Room on the disk of the library; see `Space`."""

    free_bytes: int
    used_bytes: int
    bin_bytes: int
    upload_bytes: int


@router.get("/space")
def show_space(served: Served) -> SpaceOut:
    """What is free, what the scans and the bin take, and how large an upload may be."""
    space = served.library.space()
    return SpaceOut(
        free_bytes=space.free_bytes, used_bytes=space.used_bytes, bin_bytes=space.bin_bytes,
        upload_bytes=served.library.upload_bytes,
    )  # fmt: skip


@router.get("/bin")
def list_bin(served: Served) -> list[BinOut]:
    """What was thrown away, newest first."""
    return [
        BinOut(
            key=thrown.key, name=thrown.name, title=thrown.scan.title, created=thrown.scan.created,
            deleted=thrown.deleted, pictures=thrown.scan.pictures, points=thrown.scan.points,
            frees_bytes=thrown.scan.size_bytes,
        )
        for thrown in served.library.bin()
    ]  # fmt: skip


@router.delete("/bin")
def empty_bin(served: Served, frees: Frees) -> ErasedOut:
    """Erase all of it for good; nothing where that would free something else."""
    count = len(served.library.bin())
    return ErasedOut(scans=count, freed_bytes=served.library.empty(None, frees))


@router.delete("/bin/{key}")
def erase_scan(served: Served, key: str, frees: Frees) -> ErasedOut:
    """Erase one scan for good; not where that would free something else."""
    return ErasedOut(scans=1, freed_bytes=served.library.empty([key], frees))


@router.post("/bin/{key}/restore")
def restore_scan(served: Served, key: str) -> ScanOut:
    """Take it back from the bin."""
    return shown_scan(served.library.restore(key))
