"""The calibrations that are kept: looked at, compared, chosen, taken in and out."""

from typing import Annotated, Literal

from fastapi import APIRouter, Path, Query, Request, Response
from fastapi.responses import FileResponse
from pydantic import BaseModel
from starlette.concurrency import run_in_threadpool

from app.api.calibration_models import (
    CalibrationDetailOut,
    CalibrationOut,
    ComparisonOut,
    compared,
    shown_calibration,
    shown_detail,
)
from app.api.services import Served, Services
from app.calibration.compare import compare
from app.calibration.foreign.importing import MOST_BYTES, parse_calibration
from app.calibration.foreign.opencv import as_opencv
from app.calibration.record import CalibrationRecord
from app.calibration.store import KeptCalibration
from app.devices.frame import Mounting, Rotation
from app.errors import CalibrationFileError, NotThere, TooLarge

router = APIRouter(prefix="/calibrations", tags=["calibrations"])
Name = Annotated[str, Path(max_length=255)]
NameAsked = Annotated[str, Query(min_length=1, max_length=255)]
_REPORT_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; sandbox"
_BODY = {
    "requestBody": {
        "required": True,
        "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}},
    }
}


class ImportedOut(BaseModel):
    """What came of an import.

    Attributes:
        calibration: as it is kept.
        was_there: whether the same was kept already.
    """

    calibration: CalibrationDetailOut
    was_there: bool


@router.get("")
def list_calibrations(served: Served, *, removed: bool = False) -> list[CalibrationOut]:
    """All that are kept, or all in the bin, newest first."""
    return [shown_calibration(kept) for kept in reversed(served.calibrations.kept(in_bin=removed))]


@router.get("/compare")
def compare_calibrations(served: Served, first: NameAsked, second: NameAsked) -> ComparisonOut:
    """What the second has changed against the first, and what that means at the object."""
    old, new = _record(served, first), _record(served, second)
    return compared(compare(old, new), old.expected_error_mm, new.expected_error_mm)


@router.post("/import", status_code=201, openapi_extra=_BODY)
async def import_calibration(
    request: Request,
    served: Served,
    file: Annotated[str, Query(min_length=1, max_length=255, description="What the file is called.")],
    rotation: Annotated[
        Literal["0", "90", "180", "270"] | None,
        Query(description="How pictures are turned, degrees clockwise; by default as on this bench."),
    ] = None,
    mirror: Annotated[
        bool | None, Query(description="Whether they are mirrored then; by default as on this bench.")
    ] = None,
    use: Annotated[bool, Query(description="Use it from now on.")] = False,
) -> ImportedOut:
    """Keep one of this program, of Horus or FabScanPi, or a camera of OpenCV; the file is the body."""
    data = await _body(request)
    mounting = _mounting(served, rotation, mirror)
    return await run_in_threadpool(_imported, served, data, file, mounting, use)


@router.get("/{name}")
def show_calibration(served: Served, name: Name) -> CalibrationDetailOut:
    """One, with its residuals, its proof and what it does not know; `current` is the one in use."""
    return shown_detail(_kept(served, name))


@router.post("/{name}/use")
def use_calibration(served: Served, name: Name) -> CalibrationDetailOut:
    """Use it from now on; one that is in the bin comes back."""
    in_bin = {path.stem for path in served.calibrations.removed()}
    path = served.calibrations.use(name if name in in_bin else _kept(served, name).name)
    served.on_calibrated(CalibrationRecord.load(path))
    return shown_detail(_kept(served, path.stem))


@router.delete("/{name}")
def remove_calibration(served: Served, name: Name) -> CalibrationOut:
    """Put it into the bin, with its report; the answer names it there."""
    path = served.calibrations.remove(_kept(served, name).name)
    _tell_current(served)
    return shown_calibration(
        next(kept for kept in served.calibrations.kept(in_bin=True) if kept.path == path)
    )


@router.post("/bin/{name}/restore")
def restore_calibration(served: Served, name: Name) -> CalibrationOut:
    """Take it back from the bin; the one in use stays."""
    if name not in {path.stem for path in served.calibrations.removed()}:
        raise NotThere(f"The bin holds no calibration {name!r}.")
    path = served.calibrations.restore(name)
    return shown_calibration(_kept(served, path.stem))


@router.get("/{name}/calibration.json", response_class=Response)
def download_calibration(served: Served, name: Name) -> Response:
    """The whole file, for this program elsewhere."""
    kept = _kept(served, name)
    return _download(_record(served, name).to_bytes(), "application/json", f"{kept.name}.json")


@router.get("/{name}/opencv.yml", response_class=Response)
def download_opencv(served: Served, name: Name) -> Response:
    """Camera, lasers and axis as OpenCV's YAML."""
    kept = _kept(served, name)
    return _download(as_opencv(_record(served, name)), "application/yaml", f"{kept.name}.yml")


@router.get("/{name}/report.html", response_class=FileResponse)
def show_report(served: Served, name: Name) -> FileResponse:
    """Residuals, coverage, stripes and wobble, as they were drawn when it was made."""
    path = _kept(served, name).path.with_suffix(".html")
    if path.is_symlink() or not path.is_file():
        raise NotThere(f"The calibration {name!r} has no report.", "Only those that were made here have one.")
    return FileResponse(path, media_type="text/html", headers={"Content-Security-Policy": _REPORT_POLICY})


def _kept(served: Services, name: str) -> KeptCalibration:
    """By its whole name: nothing a client sends becomes part of a path."""
    if name == "current":
        name = served.calibrations.current_path().stem
    for kept in served.calibrations.kept():
        if kept.name == name:
            return kept
    raise NotThere(f"There is no calibration {name!r}.")


def _record(served: Services, name: str) -> CalibrationRecord:
    kept = _kept(served, name)
    if kept.record is None:
        raise CalibrationFileError(kept.name, kept.problem)
    return kept.record


def _imported(
    served: Services, data: bytes, file: str, mounting: Mounting, use: bool
) -> ImportedOut:  # fmt: skip
    called = file.replace("\\", "/").rpartition("/")[2] or "upload"
    record = parse_calibration(data, called, mounting)
    store = served.calibrations
    same = next((kept for kept in store.kept() if _is_same(kept, record)), None)
    name = same.name if same is not None else store.save(record, is_current=False).stem
    if use:
        store.use(name)
    _tell_current(served)
    return ImportedOut(calibration=shown_detail(_kept(served, name)), was_there=same is not None)


def _is_same(kept: KeptCalibration, record: CalibrationRecord) -> bool:
    return kept.record is not None and kept.record.to_bytes() == record.to_bytes()


def _tell_current(served: Services) -> None:
    """Another may be in use now."""
    record = served.calibration()
    if record is not None:
        served.on_calibrated(record)


def _mounting(served: Services, rotation: str | None, mirror: bool | None) -> Mounting:
    camera = served.bench.description.camera
    turns: dict[str, Rotation] = {"0": 0, "90": 90, "180": 180, "270": 270}
    return Mounting(
        camera.rotation if rotation is None else turns[rotation],
        camera.mirror if mirror is None else mirror,
    )


async def _body(request: Request) -> bytes:
    data = bytearray()
    async for part in request.stream():
        data += part
        if len(data) > MOST_BYTES:
            raise TooLarge(
                f"The file is larger than {MOST_BYTES // 2**20} MB.", "No calibration is so large."
            )
    return bytes(data)


def _download(data: bytes, media_type: str, name: str) -> Response:
    headers = {"Content-Disposition": f'attachment; filename="{name}"'}
    return Response(data, media_type=media_type, headers=headers)
