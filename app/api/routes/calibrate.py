"""Calibrating on the bench: begun, followed live, answered, taken up again."""

from datetime import datetime
from typing import Annotated, Literal

from fastapi import APIRouter, Path, Response
from pydantic import BaseModel, Field

from app.api.routes.jobs import JobOut, shown
from app.api.services import Served, Services
from app.calibration.capture_events import simulated_hands
from app.calibration.record import CalibrationRecord
from app.devices.bench import Bench
from app.errors import NotThere, OptionError
from app.jobs.calibrate import (
    calibrate_work,
    camera_in,
    new_session_folder,
    redo,
    session_folder,
    sessions,
)
from app.jobs.calibrate_order import CalibrationOrder, Hands, board_as_measured
from app.jobs.calibrate_run import CalibrationRun
from app.jobs.calibrate_state import CalibrationState, Kind, Step
from app.jobs.calibrate_views import thumbnail
from app.jobs.events import CalibrationChanged
from app.recording.manifest_facts import BoardFacts
from app.vision.board import BoardSpec

router = APIRouter(prefix="/calibrate", tags=["calibrate"])
_TITLES = {
    Kind.AUTOMATIC: "Automatic calibration",
    Kind.FULL: "Calibration",
    Kind.CAMERA: "Calibration of the camera",
    Kind.TABLE: "Calibration of lasers and axis",
    Kind.PAPER: "Calibration step by step",
}
JobId = Annotated[str, Path(max_length=200)]
ViewNumber = Annotated[int, Path(ge=0, le=1_000_000)]


class CalibrateIn(BaseModel):
    """A calibration that is wanted.

    Attributes:
        kind: `automatic`: one board, placed twice on the table. `full`: the board held before the camera,
            too. `camera`: only that. `table`: lasers and axis for a camera that is calibrated. `paper`:
            camera, laser planes and axis one after the other, as in Rui Wang's paper.
        board: that is shown; by default the one in the bench file.
        ruler_mm: what the printed ruler of 100 mm measures.
        camera: of kind `table`: name of the calibration whose camera is taken; by default the newest that
            fits.
        hands: who shows the board; `simulated` only on a simulated bench, where all then goes by itself.
    """

    kind: Kind = Kind.AUTOMATIC
    board: BoardFacts | None = None
    ruler_mm: Annotated[float, Field(ge=50.0, le=200.0)] = 100.0
    camera: Annotated[str, Field(max_length=200)] = ""
    hands: Hands = "person"


class SessionIn(BaseModel):
    """A calibration to go on with.

    Attributes:
        session: name of its pictures.
        redo: a step that is to be done again; `solving` computes again from what there is.
        hands: who shows the board; by default who did.
    """

    session: Annotated[str, Field(min_length=1, max_length=200)]
    redo: Step | None = None
    hands: Hands | None = None


class SessionOut(BaseModel):
    """Pictures of a calibration; see `SessionFacts`."""

    name: str
    kind: Kind | None
    pictures: int
    calibration: str
    created: datetime
    problem: str


@router.post("")
def start_calibration(served: Served, wanted: CalibrateIn) -> JobOut:
    """Begin one; follow it with its job's id."""
    board = _board(served.bench, wanted)
    _check_hands(served.bench, wanted.hands)
    camera = _camera(served, wanted) if wanted.kind is Kind.TABLE else None
    order = CalibrationOrder(
        new_session_folder(served.calibrations), wanted.kind, board, camera, wanted.hands
    )
    # What cannot be computed in the end is refused before anything is taken.
    order.calibration_plan()
    return _begun(served, order)


@router.post("/resume")
def resume_calibration(served: Served, wanted: SessionIn) -> JobOut:
    """Go on with one that ended early, or do a step of it again; what was taken stays."""
    folder = session_folder(served.calibrations, wanted.session)
    if folder is None:
        raise NotThere(f"There are no pictures of a calibration {wanted.session!r}.")
    order = CalibrationOrder.load(folder)
    hands = wanted.hands or order.hands
    _check_hands(served.bench, hands)
    if wanted.redo is not None:
        redo(folder, wanted.redo)
    resumed = CalibrationOrder(folder, order.kind, order.board, order.camera, hands, order.calibration)
    return _begun(served, resumed)


@router.get("/sessions", operation_id="list_calibration_sessions")
def list_sessions(served: Served) -> list[SessionOut]:
    """Pictures of all calibrations that can be gone on with, newest first."""
    return [SessionOut.model_validate(each, from_attributes=True) for each in sessions(served.calibrations)]


@router.get("/latest")
def show_latest(served: Served) -> CalibrationState | None:
    """The calibration that was begun last in this run of the server; null where there was none."""
    run = served.calibrating.latest
    return None if run is None else run.state


@router.get("/{job_id}", operation_id="show_calibration_job")
def show_calibration(served: Served, job_id: JobId) -> CalibrationState:
    """How it goes."""
    return served.calibrating.find(job_id).state


@router.post("/{job_id}/continue")
def continue_calibration(served: Served, job_id: JobId) -> CalibrationState:
    """What was asked for is done; or the camera's views are enough."""
    return served.calibrating.find(job_id).go_on()


@router.post("/{job_id}/take")
def take_view(served: Served, job_id: JobId) -> CalibrationState:
    """Take a view now, whatever it adds."""
    return served.calibrating.find(job_id).take()


@router.post("/{job_id}/views/{number}/strike")
def strike_view(served: Served, job_id: JobId, number: ViewNumber) -> CalibrationState:
    """Leave a view out; it stays on disk."""
    return served.calibrating.find(job_id).strike(number, is_struck=True)


@router.post("/{job_id}/views/{number}/restore")
def restore_view(served: Served, job_id: JobId, number: ViewNumber) -> CalibrationState:
    """Use a view after all."""
    return served.calibrating.find(job_id).strike(number, is_struck=False)


@router.get("/{job_id}/views/{number}.jpg", response_class=Response, operation_id="show_calibration_view")
def show_view(served: Served, job_id: JobId, number: ViewNumber) -> Response:
    """A small picture of a view."""
    data = thumbnail(served.calibrating.find(job_id).folder, number)
    headers = {"Cache-Control": "private, max-age=86400, immutable"}
    return Response(data, media_type="image/jpeg", headers=headers)


def _begun(served: Services, order: CalibrationOrder) -> JobOut:
    bench = served.bench
    bench.connect_camera()
    hands = None if order.hands == "person" or bench.world is None else simulated_hands(bench.world)

    def changed(state: CalibrationState) -> None:
        served.runner.bus.publish(CalibrationChanged(state))

    order.save()
    run = CalibrationRun(order, bench.camera.facts.size, changed, hands)
    served.live.learn(board=order.board)
    work = calibrate_work(bench, run, served.calibrations, served.on_calibrated, served.on_boards)
    job = served.runner.submit("calibrate", _TITLES[order.kind], work, needs_bench=True)
    served.calibrating.add(job.id, run)
    return shown(job)


def _board(bench: Bench, wanted: CalibrateIn) -> BoardSpec:
    if wanted.board is not None:
        spec = wanted.board.spec()
    elif bench.description.board is not None:
        spec = bench.description.board.spec()
    elif bench.world is not None:
        spec = bench.world.stage.board
    else:
        raise OptionError("Nothing says which board is used.", "Name it, or add a [board] to the bench file.")
    spec = board_as_measured(spec, wanted.ruler_mm)
    spec.check()
    return spec


def _check_hands(bench: Bench, hands: Literal["person", "simulated"]) -> None:
    if hands == "simulated" and bench.world is None:
        raise OptionError("This bench has no simulated hands.", "Show the board yourself.")


def _camera(served: Services, wanted: CalibrateIn) -> CalibrationRecord | None:
    if wanted.camera:
        return CalibrationRecord.load(served.calibrations.find(wanted.camera))
    served.bench.connect_camera()
    return camera_in(served.calibrations, served.bench.camera.facts.size)
