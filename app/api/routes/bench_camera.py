"""The camera's controls: read, written and read back, and the exposure found by itself."""

from typing import Annotated, Literal

from fastapi import APIRouter
from pydantic import BaseModel, Field

from app.api.services import Served
from app.devices.camera import CameraSettings
from app.devices.camera_driver import Control, ControlName
from app.devices.exposure import find_exposure
from app.devices.frame import Use
from app.errors import OptionError
from app.jobs.events import BenchChanged

router = APIRouter(prefix="/bench/camera", tags=["bench"])
Value = Annotated[float, Field(ge=-1e9, le=1e9, allow_inf_nan=False)] | Literal["auto"]


class ControlOut(BaseModel):
    """A control.

    Attributes:
        name: which; exposure in microseconds, white balance in kelvin, the others on the camera's own scale.
        present: whether this camera has it.
        value: as the camera has it now; None where it does not tell.
        lowest, highest: its range; None where unknown.
        automatic: whether the camera changes it by itself.
        uses: what it is set to while pictures for lasers, texture or the board are taken, where that is set.
    """

    name: ControlName
    present: bool
    value: float | None = None
    lowest: float | None = None
    highest: float | None = None
    automatic: bool = False
    uses: dict[Use, Value] = {}


class ControlsIn(BaseModel):
    """Values to set now, and to keep for one use; `auto` leaves a control to the camera."""

    use: Use = Use.LASER
    values: Annotated[dict[ControlName, Value], Field(min_length=1)]


class ExposureIn(BaseModel):
    """Which laser to expose for; the first where none is named."""

    laser: Annotated[str, Field(max_length=200)] | None = None
    longest_us: Annotated[float, Field(gt=0.0, le=1e7)] | None = None


class ExposureOut(BaseModel):
    """What was found; the camera has it, and keeps it for laser pictures.

    Attributes:
        control: exposure, or gain of a camera without.
        clipped: share of the stripe's lines that are saturated with it.
        bright_grey: brightness of the stripe, grey levels.
        pictures: that were taken.
        advice: empty where all is well; `dim` or `uneven`, see `find_exposure`.
    """

    control: ControlOut
    clipped: float
    bright_grey: float
    pictures: int
    advice: Literal["", "dim", "uneven"]


@router.get("/controls")
def show_controls(served: Served) -> list[ControlOut]:
    """Every control there may be, those that this camera lacks among them."""
    return _shown(served)


@router.patch("/controls")
def change_controls(served: Served, wanted: ControlsIn) -> list[ControlOut]:
    """Set some, while no job holds the bench; answered as the camera has taken them."""
    served.bench.refuse_held("setting its camera")
    camera = served.bench.camera
    for name, value in wanted.values.items():
        taken = camera.set_control(name, None if value == "auto" else value)
        _keep(served, wanted.use, taken)
    served.runner.bus.publish(BenchChanged())
    return _shown(served)


@router.post("/find-exposure")
def find_laser_exposure(served: Served, wanted: ExposureIn) -> ExposureOut:
    """Light a laser and look for the longest exposure that does not saturate its stripe."""
    bench = served.bench
    name = wanted.laser or next(iter(bench.lasers), "")
    if name not in bench.lasers:
        known = ", ".join(bench.lasers) or "none"
        raise OptionError(f"The bench has no laser called {name!r}.", f"It has: {known}.")
    known_now = served.live.known
    with bench.lease("finding the exposure", wait_s=0.0):
        bench.camera.prepare(Use.LASER)
        found = find_exposure(
            bench.camera,
            lambda is_on: bench.switch(name, is_on),
            colour=bench.lasers[name].colour,
            orientation=known_now.orientation(name),
            detector=served.live.settings.detector,
            longest_us=wanted.longest_us,
        )
    _keep(served, Use.LASER, found.control)
    served.runner.bus.publish(BenchChanged())
    return ExposureOut(
        control=_control(served, found.control.name, found.control),
        clipped=found.look.clipped,
        bright_grey=found.look.bright_grey,
        pictures=len(found.tried),
        advice=found.advice,
    )


def _keep(served: Served, use: Use, taken: Control) -> None:
    """For the next pictures of that use, until the server ends."""
    settings = served.bench.camera.settings
    kept = dict(settings[use].controls) if use in settings else {}
    kept[taken.name] = None if taken.is_automatic else taken.value
    settings[use] = CameraSettings(kept)


def _shown(served: Served) -> list[ControlOut]:
    there = served.bench.camera.controls()
    return [_control(served, name, there.get(name)) for name in ControlName]


def _control(served: Served, name: ControlName, control: Control | None) -> ControlOut:
    uses: dict[Use, Value] = {}
    for use, settings in served.bench.camera.settings.items():
        if name in settings.controls:
            value = settings.controls[name]
            uses[use] = "auto" if value is None else value
    if control is None:
        return ControlOut(name=name, present=False, uses=uses)
    return ControlOut(
        name=name, present=True, value=control.value, lowest=control.lowest, highest=control.highest,
        automatic=control.is_automatic, uses=uses,
    )  # fmt: skip
