"""Cleaning and measuring clouds: what steps there are, what they would do, and how large things are."""

import json
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import anyio
import numpy as np
from fastapi import APIRouter, Query
from pydantic import BaseModel, Field, FiniteFloat

from app.api.services import Served, Services
from app.geometry.cloud import PointCloud
from app.jobs.clouds import cloud_of
from app.jobs.finishing import finishing_of
from app.jobs.job import JobState
from app.surface.finish import Preset
from app.surface.meshing.options import MeshOptions
from app.surface.step import STEPS, StepDocument, parse_step

if TYPE_CHECKING:
    from app.surface.preview_steps import StepPreview

router = APIRouter(prefix="/surface", tags=["surface"])
# Each takes seconds of every core, and memory: the others wait.
_ONE_AT_A_TIME = anyio.CapacityLimiter(1)
_COLOURS = "texture"
_STAYS, _GONE = (110, 114, 120), (200, 0, 0)
Name = Annotated[str, Field(min_length=1, max_length=200)]
Place = tuple[FiniteFloat, FiniteFloat, FiniteFloat]
CloudName = Annotated[str, Query(max_length=300)]
Steps = Annotated[list[StepDocument], Field(max_length=50)]


class StepKindOut(BaseModel):
    """A kind of step: its name, what it does, and its settings as a JSON schema, of which a form is made."""

    kind: str
    words: str
    settings: dict[str, Any]


class FinishPresetOut(BaseModel):
    """What a preset does to a certain cloud."""

    preset: Preset
    steps: list[StepDocument]
    mesh: MeshOptions


class CleaningIn(BaseModel):
    """Steps to try on a cloud of a scan, its newest where none is named.

    Attributes:
        shows: in the 3D view, too.
        marks: points that would go are shown, too, in red.
    """

    scan: Name
    cloud: Name | None = None
    steps: Steps
    shows: bool = True
    marks: bool = False


class StepEffectOut(BaseModel):
    """What one step did to the copy: see `StepEffect`."""

    kind: str
    before: int
    after: int
    taken: int
    note: str


class CleaningOut(BaseModel):
    """What steps would do, tried on a thinned copy; `share` is its part of all points.

    Attributes:
        points: of the whole cloud.
        left: points that would be left of them.
        shown: whether the 3D view shows the copy; it does not while it shows a scan that goes on.
    """

    scan: str
    cloud: str
    points: int
    left: int
    share: float
    effects: list[StepEffectOut]
    shown: bool


class AgainstIn(BaseModel):
    """A cloud to compare with, the newest of its scan where none is named."""

    scan: Name
    cloud: Name | None = None


class SurfaceMeasureIn(BaseModel):
    """What to measure of a cloud, after steps that are tried on it, such as a crop; millimetres.

    Attributes:
        shape: to fit.
        ends: of a distance.
        against: what to compare with, in the same place.
        scale_mm: where the colours of the comparison end.
        shows: the comparison in the 3D view.
    """

    scan: Name
    cloud: Name | None = None
    steps: Steps = []
    shape: Literal["plane", "sphere", "cylinder"] | None = None
    ends: tuple[Place, Place] | None = None
    against: AgainstIn | None = None
    scale_mm: Annotated[float, Field(gt=0.0, le=1000.0)] | None = None
    shows: bool = True


class SizeOut(BaseModel):
    """Boxes around it; see `Size`."""

    low_mm: list[float]
    high_mm: list[float]
    extent_mm: list[float]
    smallest_mm: list[float]
    turned_deg: float
    area_mm2: float | None
    volume_mm3: float | None


class FitOut(BaseModel):
    """A shape through most of the points; see `Fit`."""

    kind: str
    centre_mm: list[float]
    direction: list[float] | None
    radius_mm: float | None
    diameter_mm: float | None
    rms_mm: float
    robust_mm: float
    used: int
    given: int


class SpanOut(BaseModel):
    """A distance between two measured places; see `Span`."""

    start_mm: list[float]
    end_mm: list[float]
    distance_mm: float
    moved_mm: list[float]


class HistogramOut(BaseModel):
    """How many points lie between every two edges."""

    edges_mm: list[float]
    counts: list[int]


class DeviationMapOut(BaseModel):
    """How the points lie to another cloud; see `DeviationMap`."""

    points: int
    signed: bool
    mean_mm: float
    median_mm: float
    median_away_mm: float
    rms_mm: float
    p95_mm: float
    largest_mm: float
    scale_mm: float
    histogram: HistogramOut


class SurfaceMeasuresOut(BaseModel):
    """What was measured; what was not asked for is null.

    Attributes:
        points: that were measured.
        whole: points that the cloud has; where they are more than were read, an even choice was.
        shown: whether the 3D view shows the comparison.
    """

    points: int
    whole: int
    size: SizeOut
    fit: FitOut | None
    distance: SpanOut | None
    deviation: DeviationMapOut | None
    shown: bool


@router.get("/steps")
def list_surface_steps() -> list[StepKindOut]:
    """Every kind of step, by name."""
    return [_shown_kind(kind) for kind in STEPS]


@router.get("/presets/{scan}")
def list_surface_presets(served: Served, scan: str, cloud: CloudName = "") -> list[FinishPresetOut]:
    """What each preset would do with a cloud of a scan, its newest where none is named."""
    found = finishing_of(served.library.scan(scan), cloud)
    return [
        FinishPresetOut(preset=preset, steps=list(each.steps), mesh=each.mesh)
        for preset, each in found.items()
    ]


@router.post("/preview")
async def try_surface_steps(served: Served, wanted: CleaningIn) -> CleaningOut:
    """Try steps on a thinned copy of a cloud: how many points each would take. Nothing is kept."""
    return await anyio.to_thread.run_sync(_tried, served, wanted, limiter=_ONE_AT_A_TIME)


@router.post("/measure")
async def measure_surface(served: Served, wanted: SurfaceMeasureIn) -> SurfaceMeasuresOut:
    """Measure a cloud: its size, a fitted shape, a distance, its difference from another cloud."""
    return await anyio.to_thread.run_sync(_measured, served, wanted, limiter=_ONE_AT_A_TIME)


def _shown_kind(kind: str) -> StepKindOut:
    maker = STEPS.maker(kind)
    assert isinstance(maker, type)
    assert issubclass(maker, BaseModel)
    settings = maker.model_json_schema()
    # The words are for programmers; every setting has its own.
    words = str(settings.pop("description", "")).split("\n\n")[0]
    return StepKindOut(kind=kind, words=" ".join(words.split()), settings=settings)


def _tried(served: Services, wanted: CleaningIn) -> CleaningOut:
    from app.surface.measure.thing import file_points

    scan, path, name = _found(served, wanted.scan, wanted.cloud)
    whole = file_points(path)
    found = _preview(path, path.stat().st_mtime_ns, whole, json.dumps(wanted.steps, sort_keys=True))
    is_free = wanted.shows and not _is_scanning(served)
    if is_free:
        shown = _marked(found.cloud, found.gone) if wanted.marks else found.cloud
        served.scene.show_cloud(scan, name, shown)
        if wanted.marks:
            served.scene.colour_by(_COLOURS)
    return CleaningOut(
        scan=scan, cloud=name, points=whole, left=round(len(found.cloud) / found.share), share=found.share,
        effects=[
            StepEffectOut(
                kind=each.kind, before=each.before, after=each.after, taken=each.taken, note=each.note
            )
            for each in found.effects
        ],
        shown=is_free,
    )  # fmt: skip


@lru_cache(maxsize=2)
def _preview(path: Path, changed_ns: int, whole: int, steps: str) -> "StepPreview":
    """Steps, as JSON, tried on a file as it was then; who looks to and fro between two does not wait."""
    from app.surface.preview_steps import preview_steps

    parsed = [parse_step(document) for document in json.loads(steps)]
    return preview_steps(_copy(path, changed_ns), parsed, whole=whole)


@lru_cache(maxsize=1)
def _copy(path: Path, changed_ns: int) -> PointCloud:
    """Thinned; read once, however many steps are tried on it."""
    from app.surface.measure.thing import read_cloud
    from app.surface.preview_steps import PREVIEW_POINTS

    return read_cloud(path, PREVIEW_POINTS)


def _marked(left: PointCloud, gone: PointCloud) -> PointCloud:
    """Both, grey what stays and red what is gone."""
    return PointCloud.joined(
        [
            replace(cloud, colours=np.full_like(cloud.colours, colour))
            for cloud, colour in ((left, _STAYS), (gone, _GONE))
        ]
    )


def _measured(served: Services, wanted: SurfaceMeasureIn) -> SurfaceMeasuresOut:
    from app.surface.measure.deviation_map import deviation_map
    from app.surface.measure.distance import span_between
    from app.surface.measure.fits import fit
    from app.surface.measure.size import size_of_points
    from app.surface.measure.thing import file_points, read_cloud

    steps = [parse_step(document) for document in wanted.steps]
    scan, path, name = _found(served, wanted.scan, wanted.cloud)
    other = None if wanted.against is None else _found(served, wanted.against.scan, wanted.against.cloud)[1]
    cloud = read_cloud(path)
    for step in steps:
        cloud = step.apply(cloud)
    told: dict[str, Any] = {"fit": None, "distance": None, "deviation": None}
    told["size"] = size_of_points(cloud.points).as_json()
    if wanted.shape is not None:
        told["fit"] = fit(wanted.shape, cloud.points).as_json()
    if wanted.ends is not None:
        start, end = (np.array(place) for place in wanted.ends)
        told["distance"] = span_between(cloud.points, start, end).as_json()
    is_shown = other is not None and wanted.shows and not _is_scanning(served)
    if other is not None:
        found = deviation_map(cloud, read_cloud(other), wanted.scale_mm)
        told["deviation"] = found.as_json()
        if is_shown:
            served.scene.show_cloud(scan, name, found.cloud)
            served.scene.colour_by(_COLOURS)
    return SurfaceMeasuresOut.model_validate(
        told | {"points": len(cloud), "whole": file_points(path), "shown": is_shown}
    )


def _found(served: Services, scan: str, cloud: str | None) -> tuple[str, Path, str]:
    """The scan's name, the cloud's file, and the cloud's name."""
    item = served.library.scan(scan)
    path = cloud_of(item, cloud or "")
    return item.name, path, path.relative_to(item.folder).as_posix()


def _is_scanning(served: Services) -> bool:
    """Whether the 3D view belongs to a scan that goes on."""
    busy = (JobState.RUNNING, JobState.PAUSED)
    return served.scene.shown.is_live and any(
        job.kind == "scan" and job.state in busy for job in served.runner.jobs()
    )
