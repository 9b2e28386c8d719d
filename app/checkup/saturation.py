"""How much of each stripe is clipped, which spoils its middle, and the exposure that clips none."""

import numpy as np

from app.checkup.examination import Examination, LaserLook
from app.checkup.finding import Finding, State
from app.devices.camera_driver import ControlName
from app.devices.exposure import find_exposure
from app.devices.stripe_look import MOST_CLIPPED
from app.errors import DeviceError

_SPOILT_SHARE = 0.5


def measure_saturation(exam: Examination) -> tuple[Finding, ...]:
    """Every laser that lights; for those that are too bright, the exposure search says what to write."""
    lit = [look for look in exam.looks if look.is_lit]
    shares = {look.entry.name: float(np.mean(look.stripe.saturated)) for look in lit}
    return tuple(
        judge_saturation(look, shares[look.entry.name], _advice(exam, look.entry.name))
        if shares[look.entry.name] > MOST_CLIPPED
        else judge_saturation(look, shares[look.entry.name], "")
        for look in lit
    )


def judge_saturation(look: LaserLook, share: float, advice: str) -> Finding:
    name = look.entry.name
    numbers = {"saturated_share": round(share, 4), "rows": len(look.stripe)}
    sentence = f"of the rows of laser {name}'s stripe are saturated."
    values = {"percent": round(100 * share, 1)}
    if share <= MOST_CLIPPED:
        return Finding(
            f"picture.saturation.{name}", State.OK, f"{100 * share:.1f} % {sentence}", "", numbers,
            values=values,
        )  # fmt: skip
    state = State.BAD if share > _SPOILT_SHARE else State.ATTENTION
    return Finding(
        f"picture.saturation.{name}", state, f"{100 * share:.0f} % {sentence}", advice, numbers, values=values
    )


def _advice(exam: Examination, laser: str) -> str:
    """What the exposure search finds; the camera is as before afterwards."""
    bench = exam.bench
    exam.tell(f"looking for the exposure of laser {laser}")
    before = bench.camera.controls()
    try:
        found = find_exposure(
            bench.camera, lambda is_on: bench.switch(laser, is_on), colour=bench.lasers[laser].colour
        )
    except DeviceError as error:
        return f"The exposure search ends in this: {error.message}. {error.hint}"
    finally:
        for name in (ControlName.EXPOSURE, ControlName.GAIN):
            if name in before:
                bench.camera.set_control(name, None if before[name].is_automatic else before[name].value)
    control = found.control
    value = "" if control.value is None else f"{control.value:.0f}"
    return (
        f"Write {control.name} = {value} under [camera.laser] in the bench file: then "
        f"{100 * found.look.clipped:.1f} % are."
    )
