"""Jobs that are asked for: each kind with its options, and again."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Annotated, Any, Literal, TypeVar

from fastapi import APIRouter
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from app.api.routes.jobs import JobOut, Name, shown
from app.api.services import Served, Services
from app.calibration.record import CalibrationRecord
from app.errors import CalibrationFileError, OptionError, ScanBusy, ScanNotFound
from app.jobs.clouds import cloud_of
from app.jobs.estimate import ScanEstimate, estimate, refuse_without_room
from app.jobs.export import ExportForm, export_work
from app.jobs.finishing import finishing_of
from app.jobs.job import JobSnapshot
from app.jobs.join import join_work
from app.jobs.recipes import ScanOrder, checkup_work, reconstruct_work, scan_work
from app.jobs.runner import JobContext
from app.jobs.scan_parts import check_lasers
from app.jobs.surface import surface_work
from app.jobs.texture import texture_work
from app.library.again import own_calibration
from app.library.names import checked_title
from app.scanning.exposure_stack import check_exposures
from app.scanning.plan import LONGEST_EXPOSURE_US, MOST_EXPOSURES, ScanPlan
from app.scanning.reconstruct import ReconstructionOptions
from app.scanning.session import SCAN_FILE, read_plan
from app.surface.finish import Finish, Preset, TextureSize
from app.surface.joining.options import JoinOptions
from app.surface.meshing.options import MeshOptions
from app.surface.step import StepDocument, parse_step
from app.vision.polygon import MOST_CORNERS, is_polygon
from app.vision.stripe import STRIPE_DETECTORS, LaserColour

router = APIRouter(prefix="/jobs", tags=["jobs"])
Title = Annotated[str, Field(min_length=1, max_length=200)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]
Millimetres = Annotated[float, Field(ge=-10_000.0, le=10_000.0)]
CURRENT, OWN = "current", "own"


class ComputingIn(BaseModel):
    """How pictures become points.

    Attributes:
        detector: finds the stripes; by its name.
        radius_mm: points further from the axis are left out; as the calibration suggests where absent.
        above_mm, below_mm: heights over the table between which points are kept; likewise.
        min_quality: points of lower quality are left out.
        with_colour: colours are taken from the pictures with the lasers off.
        uses_markers: markers on the table tell its angle, where there are any.
        threshold: a peak is no stripe below this height, grey levels; as the detector has it where absent.
        channel: in which all lasers are looked for; in each one's own colour where absent.
        polygon: corners of the part of the picture that counts, as shares of its width and height; all where
            there are none.
    """

    detector: Annotated[str, Field(max_length=100)] = "zero-crossing"
    radius_mm: Annotated[float, Field(gt=0.0, le=10_000.0)] | None = None
    above_mm: Millimetres | None = None
    below_mm: Millimetres | None = None
    min_quality: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    with_colour: bool = True
    uses_markers: bool = True
    threshold: Annotated[float, Field(ge=1.0, le=254.0)] | None = None
    channel: LaserColour | None = None
    polygon: Annotated[list[tuple[Share, Share]], Field(max_length=MOST_CORNERS)] = []

    @property
    def options(self) -> ReconstructionOptions:
        """Raises OptionError for a detector that does not exist, or heights the wrong way round."""
        if self.detector not in STRIPE_DETECTORS:
            known = ", ".join(STRIPE_DETECTORS)
            raise OptionError(f"There is no detector called {self.detector[:60]!r}.", f"There are: {known}.")
        if self.above_mm is not None and self.below_mm is not None and self.above_mm >= self.below_mm:
            raise OptionError("above_mm must be less than below_mm.", "Points between the two are kept.")
        if not is_polygon(self.polygon):
            raise OptionError("polygon: is no part of the picture.", "Give three corners or more, or none.")
        return ReconstructionOptions(
            threshold=self.threshold, channel=self.channel, polygon=tuple(self.polygon),
            radius_mm=self.radius_mm, above_mm=self.above_mm, below_mm=self.below_mm,
            min_quality=self.min_quality, with_colour=self.with_colour, uses_markers=self.uses_markers,
        )  # fmt: skip


class ScanIn(ComputingIn):
    """A scan that is wanted.

    Attributes:
        title: what people call it.
        lasers: that scan; all where none is named.
        mode: stop for every picture, or turn steadily.
        steps: stops in one turn.
        turn_deg: how far the table turns.
        seconds_per_turn: of a steady turn.
        with_dark: pictures with the lasers off, too.
        texture_every: at every n-th stop a picture with the camera's settings for texture; 0 for none.
        together: all lasers lit in one picture.
        exposures_us: of a step scan: every picture is taken with each of these exposures, microseconds.
    """

    title: Title = "Scan"
    lasers: Annotated[list[str], Field(max_length=64)] = []
    mode: Literal["step", "continuous"] = "step"
    steps: Annotated[int, Field(ge=1, le=10_000)] = 200
    turn_deg: Annotated[float, Field(gt=0.0, le=3600.0)] = 360.0
    seconds_per_turn: Annotated[float, Field(ge=1.0, le=3600.0)] = 30.0
    with_dark: bool = True
    texture_every: Annotated[int, Field(ge=0, le=10_000)] = 0
    together: bool = False
    exposures_us: Annotated[
        list[Annotated[float, Field(gt=0.0, le=LONGEST_EXPOSURE_US)]], Field(max_length=MOST_EXPOSURES)
    ] = []


class EstimateOut(BaseModel):
    """What a scan will take; see `ScanEstimate`."""

    seconds: float
    capture_s: float
    shots: int
    points: int
    size_bytes: int
    is_measured: bool


class ResumeIn(BaseModel):
    """A scan to go on with, by its name in the library.

    Attributes:
        accept_position: take it that an interrupted move was completed, where nothing shows it.
    """

    scan: Name
    accept_position: bool = False


class ReconstructIn(ComputingIn):
    """A scan to compute again.

    Attributes:
        scan: its name in the library.
        calibration: a name in the store, `current` for the one in use, `own` for that of the scan.
    """

    scan: Name
    calibration: Name = CURRENT


class TextureIn(BaseModel):
    """A finished scan to give colours to, while its object still stands on the table.

    Attributes:
        scan: its name in the library.
        pictures: in one turn.
    """

    scan: Name
    pictures: Annotated[int, Field(ge=1, le=1000)] = 24


class ExportIn(BaseModel):
    """A cloud to write in another form.

    Attributes:
        scan: its name in the library.
        form: of the file.
        cloud: which of the scan's clouds; the newest where none is named.
    """

    scan: Name
    form: ExportForm = ExportForm.PLY
    cloud: Annotated[str, Field(max_length=300)] = ""


class SurfaceIn(BaseModel):
    """A thing to be made of a cloud.

    Attributes:
        scan: its name in the library.
        cloud: which of the scan's clouds; the newest where none is named.
        preset: what for.
        steps: that clean the cloud, in order; those of the preset where absent.
        mesh: how the mesh is made; whatever is absent is as the preset has it.
        has_mesh: whether there is to be one.
        texture_px: sides of a picture with its colours, at most; no picture where absent.
        keeps_cloud: the cleaned cloud becomes another cloud of the scan.
    """

    model_config = ConfigDict(
        json_schema_extra={"examples": [{"scan": "a-mug", "preset": "print", "mesh": {"triangles": 50_000}}]}
    )

    scan: Name
    cloud: Annotated[str, Field(max_length=300)] = ""
    preset: Preset = Preset.PRINT
    steps: Annotated[list[StepDocument], Field(max_length=30)] | None = None
    mesh: MeshOptions | None = None
    has_mesh: bool = True
    texture_px: TextureSize | None = None
    keeps_cloud: bool = False


class PartIn(BaseModel):
    """A cloud that is to be joined; the newest of its scan where none is named."""

    scan: Name
    cloud: Annotated[str, Field(max_length=300)] = ""


class JoinIn(BaseModel):
    """Several scans of one thing, to become one.

    Attributes:
        scans: two or more; all are brought into the frame of the first.
        title: of the scan that comes of it.
        options: see `JoinOptions`; clicked places of a scan in `pairs` spare the search for its position.
    """

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [{"scans": [{"scan": "mug"}, {"scan": "mug-lying"}], "title": "Mug, all of it"}]
        }
    )

    scans: Annotated[list[PartIn], Field(min_length=2, max_length=20)]
    title: Title
    options: JoinOptions = JoinOptions()


class CheckupIn(BaseModel):
    """Which checks to make; all where none is named."""

    only: Annotated[list[str], Field(max_length=20)] = []


class RetryIn(BaseModel):
    """A job to do again, or a scan to go on with.

    Attributes:
        accept_position: see `ResumeIn`.
    """

    accept_position: bool = False


@router.post("/scan")
def start_scan(served: Served, wanted: ScanIn) -> JobOut:
    """Scan what stands on the table."""
    options, plan = wanted.options, _plan(served, wanted)
    expected = _expected(served, plan)
    refuse_without_room(expected, served.library.folder)
    folder = served.library.reserve(wanted.title)
    order = ScanOrder(folder, plan, served.bench_spec, detector=wanted.detector, options=options)
    return _submitted_scan(served, wanted.title, order, wanted, expected.capture_s)


@router.post("/scan/estimate")
def estimate_scan(served: Served, wanted: ScanIn) -> EstimateOut:
    """What such a scan would take; nothing is begun."""
    expected = _expected(served, _plan(served, wanted))
    return EstimateOut.model_validate(expected, from_attributes=True)


@router.post("/resume-scan")
def resume_scan(served: Served, wanted: ResumeIn) -> JobOut:
    """Go on with a scan that ended early; its cloud is computed as was asked for at its beginning."""
    item = served.library.scan(wanted.scan)
    before = _scan_jobs(served, item.name)
    computing = (_as(ScanIn, before[0].order) if before else None) or ScanIn()
    computing.title = item.title
    order = ScanOrder(
        item.folder, None, served.bench_spec, takes_target=wanted.accept_position,
        detector=computing.detector, options=computing.options,
    )  # fmt: skip
    expected_s = None
    if (item.folder / SCAN_FILE).is_file():
        plan = read_plan(item.folder)
        expected_s = _expected(served, plan).capture_s
    return _submitted_scan(served, item.title, order, computing, expected_s)


@router.post("/reconstruct")
def start_reconstruction(served: Served, wanted: ReconstructIn) -> JobOut:
    """Compute another cloud of a scan; those it has stay."""
    item, options = served.library.scan(wanted.scan), wanted.options
    record = None if wanted.calibration == OWN else _calibration(served, wanted.calibration)
    if record is None:
        own_calibration(item.folder)
    work = reconstruct_work(served.library, item.name, record, wanted.detector, options)
    return _submitted(served, "reconstruct", item.title, work, wanted, scan=item.name)


@router.post("/texture")
def start_texture(served: Served, wanted: TextureIn) -> JobOut:
    """Turn the object once with the lasers off, and give the newest cloud of its scan the colours."""
    item = served.library.scan(wanted.scan)
    record = own_calibration(item.folder)
    work = texture_work(served.bench, served.library, item.name, record, wanted.pictures)
    return _submitted(served, "texture", item.title, work, wanted, scan=item.name, needs_bench=True)


@router.post("/export")
def start_export(served: Served, wanted: ExportIn) -> JobOut:
    """Write a cloud in another form; `GET /jobs/{id}/file` gives the file when it is done."""
    item = served.library.scan(wanted.scan)
    work = export_work(served.library, item.name, wanted.form, wanted.cloud)
    return _submitted(served, "export", item.title, work, wanted, scan=item.name)


@router.post("/surface")
def start_surface(served: Served, wanted: SurfaceIn) -> JobOut:
    """Clean a cloud and make its surface; `GET /scans/{name}/meshes` lists what came of it."""
    item = served.library.scan(wanted.scan)
    if not wanted.has_mesh and not wanted.keeps_cloud:
        raise OptionError("Nothing would come of it.", "Wish for a mesh, for the cleaned cloud, or both.")
    usual = finishing_of(item, wanted.cloud)[wanted.preset]
    options = usual.mesh
    if wanted.mesh is not None:
        options = options.model_copy(update=wanted.mesh.model_dump(exclude_unset=True))
    for document in wanted.steps or ():
        parse_step(document)
    steps = usual.steps if wanted.steps is None else tuple(wanted.steps)
    order = Finish(
        preset=wanted.preset, steps=steps, mesh=options, has_mesh=wanted.has_mesh,
        texture_px=wanted.texture_px,
    )  # fmt: skip
    work = surface_work(served.library, item.name, wanted.cloud, order, keeps_cloud=wanted.keeps_cloud)
    # With all of the mesh's options, so that it can be done again alike.
    whole = wanted.model_copy(update={"mesh": options})
    return _submitted(served, "surface", item.title, work, whole, scan=item.name)


@router.post("/join")
def start_joining(served: Served, wanted: JoinIn) -> JobOut:
    """Join several scans of one thing into a new scan of the library; they themselves stay as they are."""
    title = checked_title(wanted.title)
    parts = []
    for part in wanted.scans:
        item = served.library.scan(part.scan)
        parts.append((item.name, cloud_of(item, part.cloud).relative_to(item.folder).as_posix()))
    if len(set(parts)) < len(parts):
        raise OptionError("A cloud is named twice.", "Name different clouds of one thing.")
    work = join_work(served.library, parts, wanted.options, title)
    return _submitted(served, "join", title, work, wanted, scan=parts[0][0])


@router.post("/checkup")
def start_checkup(served: Served, wanted: CheckupIn) -> JobOut:
    """The doctor: measure what the bench really does."""
    work = checkup_work(served.bench, wanted.only, served.library.folder, served.calibration())
    return _submitted(served, "checkup", "Checkup", work, wanted, needs_bench=True)


@router.post("/{job_id}/retry")
def retry_job(served: Served, job_id: str, wanted: RetryIn) -> JobOut:
    """Go on with its scan, where that is unfinished, or with its cloud; otherwise do the same again."""
    job = served.runner.job(job_id)
    if not job.state.has_ended:
        raise OptionError(f"The job {job.title!r} has not ended.", "Resume it where it is paused.")
    if job.kind == "scan":
        _scan_jobs(served, job.scan)
    if job.can_resume:
        return resume_scan(served, ResumeIn(scan=job.scan, accept_position=wanted.accept_position))
    if job.kind == "scan" and _is_taken(served, job.scan):
        computing = (_as(ScanIn, job.order) or ScanIn()).model_dump(include=set(ComputingIn.model_fields))
        return start_reconstruction(served, ReconstructIn(scan=job.scan, calibration=OWN, **computing))
    start = _STARTS.get(job.kind)
    again = None if start is None else start(served, job.order)
    if again is None:
        raise OptionError(f"The job {job.title!r} cannot be done again from here.", "Start it anew.")
    return again


def _again(model: type[BaseModel], start: Callable[[Services, Any], JobOut]) -> "_Start":
    def again(served: Services, order: Mapping[str, Any] | None) -> JobOut | None:
        wanted = _as(model, order)
        return None if wanted is None else start(served, wanted)

    return again


Order = TypeVar("Order", bound=BaseModel)
_Start = Callable[[Services, Mapping[str, Any] | None], JobOut | None]
_STARTS: Mapping[str, _Start] = {
    "scan": _again(ScanIn, start_scan),
    "reconstruct": _again(ReconstructIn, start_reconstruction),
    "texture": _again(TextureIn, start_texture),
    "export": _again(ExportIn, start_export),
    "surface": _again(SurfaceIn, start_surface),
    "join": _again(JoinIn, start_joining),
    "checkup": _again(CheckupIn, start_checkup),
}


def _as(model: type[Order], order: Mapping[str, Any] | None) -> Order | None:
    """What was asked for; None where it is not known, or an older program asked for it in another way."""
    if order is None:
        return None
    try:
        return model.model_validate(order)
    except ValidationError:
        return None


def _scan_jobs(served: Services, name: str) -> list[JobSnapshot]:
    """The jobs that took a scan so far, newest first. Raises ScanBusy while one of them has not ended."""
    jobs = [job for job in served.runner.jobs() if job.kind == "scan" and job.scan == name]
    for job in jobs:
        if not job.state.has_ended:
            raise ScanBusy(f"The scan {job.title!r} is gone on with already.", "Follow the job that does it.")
    return jobs


def _is_taken(served: Services, name: str) -> bool:
    """Whether all pictures of a scan are there, but no cloud."""
    try:
        item = served.library.scan(name)
    except ScanNotFound:
        return False
    return item.status == "finished" and not item.clouds


def _plan(served: Services, wanted: ScanIn) -> ScanPlan:
    lasers = tuple(wanted.lasers or served.bench.lasers)
    check_lasers(served.bench, lasers, served.calibration())
    facts = wanted.model_dump(include=set(ScanPlan.model_fields))
    facts |= {"lasers": lasers, "exposures_us": tuple(wanted.exposures_us)}
    plan = ScanPlan.model_validate(facts)
    check_exposures(plan, served.bench.camera)
    return plan


def _expected(served: Services, plan: ScanPlan) -> ScanEstimate:
    return estimate(plan, served.bench, served.runner.jobs())


def _calibration(served: Services, name: str) -> CalibrationRecord:
    if name == CURRENT:
        record = served.calibration()
        if record is None:
            raise CalibrationFileError("calibration_store", "holds no calibration yet")
        return record
    return CalibrationRecord.load(served.calibrations.find(name))


def _submitted(
    served: Services,
    kind: str,
    title: str,
    work: Callable[[JobContext], Mapping[str, Any]],
    wanted: BaseModel,
    *,
    scan: str = "",
    needs_bench: bool = False,
    expected_s: float | None = None,
    on_dropped: Callable[[], None] = lambda: None,
) -> JobOut:
    job = served.runner.submit(
        kind, title, work, needs_bench=needs_bench, scan=scan, order=wanted.model_dump(mode="json"),
        expected_s=expected_s, on_dropped=on_dropped,
    )  # fmt: skip
    return shown(job)


def _submitted_scan(
    served: Services, title: str, order: ScanOrder, wanted: ScanIn, expected_s: float | None
) -> JobOut:
    def begin() -> None:
        served.on_scan()
        if order.plan is not None:
            served.library.rename(order.folder.name, title)

    def work(job: JobContext) -> Mapping[str, Any]:
        # The job before it may have been a calibration.
        record = served.calibration()
        try:
            return scan_work(served.bench, order, record, served.on_profile, begin)(job)
        finally:
            served.on_scan_end()

    def drop() -> None:
        # Only the empty folder of a scan that was never begun.
        with suppress(OSError):
            order.folder.rmdir()

    return _submitted(
        served, "scan", title, work, wanted, scan=order.folder.name, needs_bench=True,
        expected_s=expected_s, on_dropped=drop,
    )  # fmt: skip
