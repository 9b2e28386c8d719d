"""The 3D view: what it shows and how. The view itself is at `/view/`, or `/view/TAB/` for one page's own."""

import math
from typing import Annotated, Literal

from fastapi import APIRouter
from pydantic import BaseModel, Field

from app.api.scene import Box
from app.api.services import Served, Services
from app.errors import NotThere, ScanBusy
from app.jobs.job import JobState
from app.surface.ply_reader import read_ply
from app.surface.step import StepDocument, document_of, parse_step

router = APIRouter(prefix="/view", tags=["view"])
Colour = Literal["texture", "height", "laser", "quality", "angle"]
Preset = Literal["home", "top", "front", "back", "left", "right", "scanner", "camera"]
Coordinate = Annotated[float, Field(allow_inf_nan=False)]
Corner = tuple[Coordinate, Coordinate, Coordinate]
Share = Annotated[float, Field(ge=-1.0, le=2.0)]
Tab = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")]
Name = Annotated[str, Field(min_length=1, max_length=200)]


class BoxModel(BaseModel):
    """A box along the table's axes, by two of its corners: x, y, z in mm."""

    low: Corner
    high: Corner


class ViewOut(BaseModel):
    """What the view shows; see `Shown`."""

    live: bool
    scan: str
    cloud: str
    points: int
    nowhere: int
    colour: Colour
    point_size_mm: float
    dark: bool
    viewers: int
    extent: BoxModel | None
    crop: BoxModel | None
    measured: list[Corner]
    distance_mm: float | None


class ViewIn(BaseModel):
    """How to draw; what is absent stays."""

    colour: Colour | None = None
    point_size_mm: Annotated[float, Field(gt=0.0, le=20.0)] | None = None
    dark: bool | None = None


class ShowIn(BaseModel):
    """A scan of the library to show; its newest cloud where none is named."""

    scan: Name
    cloud: Name | None = None


class LookIn(BaseModel):
    """From where to look; `tab` is the page's own name of its view, all pages where it is absent."""

    preset: Preset
    tab: Tab | None = None


class PickIn(BaseModel):
    """A place in a page's view, as of `MeasureIn`; `before` are points that were picked before."""

    tab: Tab
    across: Annotated[float, Field(ge=0.0, le=1.0)]
    down: Annotated[float, Field(ge=0.0, le=1.0)]
    before: Annotated[list[Corner], Field(max_length=20)] = []


class PickOut(BaseModel):
    """The point of the cloud that lies there: x, y, z in mm, table frame."""

    point: Corner


class LassoIn(BaseModel):
    """An outline that was drawn on a page's view; its corners as of `MeasureIn`: across, then down."""

    tab: Tab
    outline: Annotated[list[tuple[Share, Share]], Field(min_length=3, max_length=2_000)]
    keep: Literal["inside", "outside"] = "outside"


class LassoOut(BaseModel):
    """The step that takes away, or keeps, what lies in the outline from where the page looks now."""

    step: StepDocument


class MeasureIn(BaseModel):
    """A place in a page's view, 0..1 from its upper left corner; `tab` is the page's own name of it."""

    tab: Tab
    across: Annotated[float, Field(ge=0.0, le=1.0)]
    down: Annotated[float, Field(ge=0.0, le=1.0)]


@router.get("")
def show_view(served: Served) -> ViewOut:
    """What is shown now."""
    return _shown(served)


@router.patch("")
def change_view(served: Served, wanted: ViewIn) -> ViewOut:
    """Colours, size of points, dark or light."""
    if wanted.colour is not None:
        served.scene.colour_by(wanted.colour)
    if wanted.point_size_mm is not None:
        served.scene.set_point_size(wanted.point_size_mm)
    if wanted.dark is not None:
        served.scene.set_dark(wanted.dark)
    return _shown(served)


@router.post("/show")
def show_scan_in_view(served: Served, wanted: ShowIn) -> ViewOut:
    """Open a finished scan in the view."""
    _refuse_while_scanning(served)
    item = served.library.scan(wanted.scan)
    names = [cloud.name for cloud in item.clouds]
    if not names:
        raise NotThere(f"The scan {item.title!r} has no cloud.", "Reconstruct it first.")
    name = wanted.cloud or names[-1]
    if name not in names:
        raise NotThere(f"The scan {item.title!r} has no cloud {name!r}.", f"It has: {', '.join(names)}.")
    served.scene.show_cloud(item.name, name, read_ply(item.folder / name, allows_nowhere=True))
    return _shown(served)


@router.post("/clear")
def clear_view(served: Served) -> ViewOut:
    """Empty the table."""
    _refuse_while_scanning(served)
    served.scene.clear()
    return _shown(served)


@router.post("/look", status_code=204)
def look_from(served: Served, wanted: LookIn) -> None:
    """Move one page, or all, to a place from which the scene is good to see."""
    served.scene.look(wanted.preset, wanted.tab)


@router.put("/crop")
def crop_view(served: Served, box: BoxModel) -> ViewOut:
    """Show what lies in a box alone; the cloud itself stays whole."""
    served.scene.crop((box.low, box.high))
    return _shown(served)


@router.delete("/crop")
def show_whole_cloud(served: Served) -> ViewOut:
    """Show the whole cloud again."""
    served.scene.crop(None)
    return _shown(served)


@router.post("/measure")
def measure_in_view(served: Served, place: MeasureIn) -> ViewOut:
    """Take the point that a page sees there; from the second on there is a distance, a third begins anew."""
    served.scene.measure_at(place.tab, place.across, place.down)
    return _shown(served)


@router.delete("/measure")
def forget_measure(served: Served) -> ViewOut:
    """Take the measured distance away."""
    served.scene.forget_measure()
    return _shown(served)


@router.post("/pick")
def pick_in_view(served: Served, place: PickIn) -> PickOut:
    """Take the point that a page sees there, and mark it with its number."""
    return PickOut(point=served.scene.pick_at(place.tab, place.across, place.down, place.before))


@router.delete("/pick", status_code=204)
def forget_picks(served: Served) -> None:
    """Take the marks away."""
    served.scene.forget_picks()


@router.post("/lasso")
def draw_lasso(served: Served, drawn: LassoIn) -> LassoOut:
    """Make a step of an outline that was drawn on a page's view. Nothing is changed."""
    matrix = served.scene.view_matrix(drawn.tab).tolist()
    polygon = [(2.0 * across - 1.0, 2.0 * down - 1.0) for across, down in drawn.outline]
    step = {"kind": "lasso", "view": matrix, "polygon": polygon, "keep": drawn.keep}
    return LassoOut(step=document_of(parse_step(step)))


def _refuse_while_scanning(served: Services) -> None:
    busy = (JobState.RUNNING, JobState.PAUSED)
    if served.scene.shown.is_live and any(
        job.kind == "scan" and job.state in busy for job in served.runner.jobs()
    ):
        raise ScanBusy(
            "The view shows the scan that is being taken.",
            "Open another scan when it has ended, or cancel it.",
        )


def _shown(served: Services) -> ViewOut:
    shown = served.scene.shown
    return ViewOut.model_validate(
        {
            "live": shown.is_live, "scan": shown.scan, "cloud": shown.cloud, "points": shown.points,
            "nowhere": shown.nowhere,
            "colour": shown.colour, "point_size_mm": shown.point_size_mm, "dark": shown.is_dark,
            "viewers": served.scene.viewers, "extent": _boxed(shown.extent), "crop": _boxed(shown.crop),
            "measured": shown.measured,
            "distance_mm": math.dist(*shown.measured) if len(shown.measured) == 2 else None,
        }
    )  # fmt: skip


def _boxed(box: Box | None) -> BoxModel | None:
    return None if box is None else BoxModel(low=box[0], high=box[1])
