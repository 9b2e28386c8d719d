"""Meshes of a scan: listed, sent in any form, shown in the 3D view."""

from datetime import datetime
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Request, Response
from pydantic import BaseModel, ConfigDict, ValidationError

from app.api.downloads import PartsResponse, attachment, file_answer
from app.api.services import Served
from app.errors import ScanBusy
from app.jobs.job import JobState
from app.library.mesh_form import MeshForm, mesh_in_form
from app.library.meshes import MeshItem, erase_mesh, loaded, mesh_of, meshes_of
from app.surface.exports.read import read_mesh
from app.surface.exports.units import Unit
from app.surface.finish import Preset
from app.surface.meshing.options import MeshOptions
from app.surface.meshing.simplify import to_count
from app.surface.step import StepDocument

router = APIRouter(prefix="/scans", tags=["scans"])
_PLY = "application/octet-stream"
_MEDIA_TYPES = {
    "stl": "model/stl", "3mf": "model/3mf", "obj": "model/obj", "glb": "model/gltf-binary", "ply": _PLY,
    "off": "text/plain", "obj-zip": "application/zip",
}  # fmt: skip
# More makes pages on phones slow, and nobody sees it.
_SHOWN_TRIANGLES = 400_000
Form = Annotated[
    MeshForm,
    Query(
        description="What the file is to be. Where the mesh has a texture, GLB holds it, and `obj-zip` is a "
        "zip file of an OBJ with its material and its picture."
    ),
]
_EXAMPLE: dict[str, Any] = {
    "name": "2026-11-21T10-20-00Z-print.ply",
    "path": "/api/v1/scans/a-mug/meshes/2026-11-21T10-20-00Z-print.ply",
    "vertices": 21_004, "triangles": 42_004, "size_bytes": 861_232, "created": "2026-11-21T10:20:00Z",
    "has_texture": False, "made": None,
}  # fmt: skip


class FindingOut(BaseModel):
    """What one check for printing says; see `Finding`."""

    check: str
    state: Literal["good", "doubt", "bad"]
    sentence: str
    advice: str


class PrintingOut(BaseModel):
    """A closed mesh as a printer sees it; see `PrintReport`."""

    findings: list[FindingOut]
    size_mm: list[float]
    volume_cm3: float
    area_cm2: float
    pla_g: float
    wall_mm: float | None


class MeshOrderOut(BaseModel):
    """What was asked for."""

    preset: Preset
    steps: list[StepDocument] | None
    mesh: MeshOptions | None
    texture_px: int | None = None


class MeshMadeOut(BaseModel):
    """How a mesh was made.

    Attributes:
        cloud: of which it was made.
        points: that the cloud has.
        used_points: those that were left after cleaning.
        guessed_share: of a closed surface, 0..1: no points are there.
        sizes: bytes of the files in each form, where they were counted.
    """

    order: MeshOrderOut
    cloud: str
    points: int
    used_points: int
    notes: list[str]
    doubts: list[str]
    guessed_share: float
    printing: PrintingOut | None
    sizes: dict[str, int] = {}


class MeshOut(BaseModel):
    """A mesh of a scan; see `MeshItem`. `path` takes `?form=stl` and others. `made` is null where unknown."""

    model_config = ConfigDict(json_schema_extra={"examples": [_EXAMPLE]})

    name: str
    path: str
    vertices: int
    triangles: int
    size_bytes: int
    created: datetime
    has_texture: bool
    made: MeshMadeOut | None


class ErasedMeshOut(BaseModel):
    """How much room a mesh took."""

    freed_bytes: int


@router.get("/{name}/meshes")
def list_meshes(request: Request, served: Served, name: str) -> list[MeshOut]:
    """Those that were made of its clouds, oldest first; `POST /jobs/surface` makes one."""
    here = request.url.path
    return [
        MeshOut(
            name=item.name, path=f"{here}/{item.name}", vertices=item.vertices, triangles=item.triangles,
            size_bytes=item.size_bytes, created=item.created, has_texture=item.has_texture, made=_made(item),
        )
        for item in meshes_of(served.library.folder_of(name))
    ]  # fmt: skip


@router.get(
    "/{name}/meshes/{mesh}",
    response_class=Response,
    responses={200: {"content": {media_type: {} for media_type in _MEDIA_TYPES.values()}}},
)
def download_mesh(
    request: Request,
    served: Served,
    name: str,
    mesh: str,
    form: Form = "ply",
    unit: Annotated[Unit, Query(description="Of the numbers in it; GLB is in metres.")] = Unit.MM,
) -> Response:
    """One of its meshes, made into the form that is asked for."""
    item = mesh_of(served.library.folder_of(name), mesh)
    title = attachment(served.library.scan(name).title, ".zip" if form == "obj-zip" else f".{form}")
    if form == "ply" and unit is Unit.MM:
        return file_answer(request, item.path, _PLY, title)
    made = mesh_in_form(form, *loaded(item), name, unit)
    headers = {"Content-Disposition": title, "Cache-Control": "no-store"}
    return PartsResponse((part for part in made), _MEDIA_TYPES[form], headers)


@router.delete("/{name}/meshes/{mesh}")
def erase_scan_mesh(served: Served, name: str, mesh: str) -> ErasedMeshOut:
    """Erase one of its meshes for good; its clouds stay."""
    return ErasedMeshOut(freed_bytes=erase_mesh(served.library, name, mesh))


@router.post("/{name}/meshes/{mesh}/show", status_code=204)
def show_mesh(served: Served, name: str, mesh: str) -> None:
    """Show it in the 3D view; of very fine ones a coarser likeness."""
    busy = (JobState.RUNNING, JobState.PAUSED)
    if served.scene.shown.is_live and any(
        job.kind == "scan" and job.state in busy for job in served.runner.jobs()
    ):
        raise ScanBusy("The view shows the scan that is being taken.", "Show the mesh when it has ended.")
    item = mesh_of(served.library.folder_of(name), mesh)
    served.scene.show_mesh(name, item.name, to_count(read_mesh(item.path), _SHOWN_TRIANGLES))


def _made(item: MeshItem) -> MeshMadeOut | None:
    try:
        return MeshMadeOut.model_validate(item.made)
    except ValidationError:
        # Of an older program, or of another.
        return None
