"""The camera's exposure while a stack is taken: set for every picture, read back, and put back at the end."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress

from app.devices.camera import Camera
from app.devices.camera_driver import Control, ControlName
from app.devices.frame import Frame, Use
from app.errors import DeviceError, DeviceRefused, DeviceTimeout, OptionError
from app.scanning.plan import Look, ScanPlan

# A camera that tells how long it exposed may be so far off what it said it would do.
_SAME = 0.1
# Some sensors take over a new exposure several pictures late.
_LATE_PICTURES = 6


def check_exposures(plan: ScanPlan, camera: Camera) -> None:
    """Whether the camera can take the stack of a plan; of one that is not connected nothing is asked.

    Raises:
        OptionError: an exposure is named twice, or the scan is continuous.
        DeviceRefused: the camera has no control of its exposure, or not that far.
        DeviceLost: it is away.
    """
    if not plan.exposures_us:
        return
    if plan.mode != "step":
        raise OptionError(
            "A continuous scan takes every picture with one exposure.", "Scan step by step, or name none."
        )
    if len(set(plan.exposures_us)) < len(plan.exposures_us):
        raise OptionError("An exposure is named twice.", "Name each one once.")
    if camera.state.is_connected:
        _control(camera, plan.exposures_us)


class ExposureStack:
    """What a scan prepares its camera with; made by `exposure_stack`.

    Args:
        camera: connected.
        made_us: by the exposure that is wanted, what the camera makes of it.
        before: what its control was.
    """

    def __init__(self, camera: Camera, made_us: dict[float, float], before: float | None) -> None:
        self._camera, self._made_us, self._before = camera, made_us, before

    def prepare(self, look: Look) -> None:
        """Set the controls for a picture."""
        use = Use.TEXTURE if look.for_colour else Use.LASER
        self._camera.prepare(use, exposure_us=look.exposure_us)
        if self._made_us and look.exposure_us is None and not _names_exposure(self._camera, use):
            self._camera.set_control(ControlName.EXPOSURE, self._before)

    def exposure_us(self, look: Look, frame: Frame) -> float | None:
        """What a picture is recorded with: the same for all that belong together."""
        return frame.exposure_us if look.exposure_us is None else self._made_us[look.exposure_us]

    def fresh_frame(self, look: Look, timeout_s: float) -> Frame:
        """A picture that was exposed after this call, and as the look wants it.

        Raises:
            DeviceTimeout: the camera goes on with another exposure.
            DeviceError: as `Camera.fresh_frame`.
        """
        made_us = 0.0 if look.exposure_us is None else self._made_us[look.exposure_us]
        timeout_s += _LATE_PICTURES * made_us * 1e-6
        for _ in range(_LATE_PICTURES):
            frame = self._camera.fresh_frame(timeout_s=timeout_s)
            if not made_us or frame.exposure_us is None or abs(frame.exposure_us / made_us - 1.0) < _SAME:
                return frame
        raise DeviceTimeout(self._camera.name, f"an exposure of {made_us:g} us", timeout_s)


@contextmanager
def exposure_stack(camera: Camera, exposures_us: Sequence[float]) -> Iterator[ExposureStack]:
    """Have the camera say what it makes of each exposure; however the block ends, its control is put back.

    Args:
        camera: connected.
        exposures_us: of the stack; with none the control is left alone.

    Raises:
        DeviceRefused: it has no such control, or makes the same of two exposures.
        DeviceLost: it is away.
    """
    if not exposures_us:
        yield ExposureStack(camera, {}, None)
        return
    before = _value_before(camera, _control(camera, exposures_us))
    try:
        told = {wanted: camera.set_control(ControlName.EXPOSURE, wanted).value for wanted in exposures_us}
        made_us = {wanted: value or wanted for wanted, value in told.items()}
        if len(set(made_us.values())) < len(made_us):
            listed = ", ".join(f"{value:g}" for value in made_us.values())
            problem = f"makes the same of two exposures (it makes them {listed} us)"
            raise DeviceRefused(camera.name, problem, "Name exposures that lie further apart.")
        yield ExposureStack(camera, made_us, before)
    finally:
        # A camera that is away is told when it is back.
        with suppress(DeviceError):
            camera.set_control(ControlName.EXPOSURE, before)


def _control(camera: Camera, exposures_us: Sequence[float]) -> Control:
    control = camera.controls().get(ControlName.EXPOSURE)
    if control is None:
        hint = "Scan with one exposure, or with another camera."
        raise DeviceRefused(camera.name, "has no control of its exposure, so it can take no stack", hint)
    for wanted in exposures_us:
        too_short = control.lowest is not None and wanted < control.lowest
        if too_short or (control.highest is not None and wanted > control.highest):
            reach = f"its exposure goes from {control.lowest or 0.0:g} to {control.highest or 0.0:g} us"
            raise DeviceRefused(camera.name, f"cannot expose for {wanted:g} us: {reach}")
    return control


def _value_before(camera: Camera, control: Control) -> float | None:
    """What to put back; None for the camera's own automatic."""
    if control.is_automatic or control.value is not None:
        return None if control.is_automatic else control.value
    if not _names_exposure(camera, Use.LASER):
        hint = "Give it one in the bench file, under [camera.laser]."
        raise DeviceRefused(camera.name, "does not tell its exposure, so it could not be put back", hint)
    return camera.settings[Use.LASER].controls[ControlName.EXPOSURE]


def _names_exposure(camera: Camera, use: Use) -> bool:
    return use in camera.settings and ControlName.EXPOSURE in camera.settings[use].controls
