"""Focus, exposure, noise, saturation of the stripes, and whether markers or board are found."""

import math

import numpy as np

from app.checkup.examination import Examination
from app.checkup.finding import Finding, State
from app.checkup.saturation import measure_saturation
from app.checkup.sharpness import blur_px
from app.checkup.target import targets_of
from app.devices.frame import Use
from app.vision.stripe import Image

_SOFT_PX, _BLURRED_PX = 2.0, 4.0
_DARK_GREY, _CLIPPED_GREY = 12.0, 254
_CLIPPED_SHARE = 0.05
_NOISY_GREY = 6.0


def measure_picture(exam: Examination) -> tuple[Finding, ...]:
    """By the light of the room, and by that of the lasers."""
    room = exam.room.image()
    pair = [exam.picture(Use.LASER).image() for _ in range(2)]
    return (
        judge_focus(blur_px(room), room.shape[1]),
        judge_exposure(room),
        judge_noise(noise_grey(*pair)),
        *_judge_targets(exam),
        *measure_saturation(exam),
    )


def noise_grey(one: Image, other: Image) -> float:
    """Standard deviation of one picture's noise, from two of the same scene; robust against what moved."""
    difference = one.astype(np.float32) - other
    # 1.4826 turns a median absolute deviation into a standard deviation; whole grey levels blunt the median.
    spread = np.quantile(np.abs(difference), 0.6827)
    return float(spread / math.sqrt(2.0))


def judge_focus(blur: float, width: int) -> Finding:
    if not math.isfinite(blur):
        return Finding(
            "picture.focus", State.SKIPPED, "The picture shows no edges to judge the focus by.",
            "Put something with a pattern on the table, such as the calibration board, and light the room.",
        )  # fmt: skip
    # What is one pixel at 1280 columns is half a pixel at 640, for lenses blur by angle.
    limit_px = _SOFT_PX * max(1.0, width / 1280.0)
    numbers = {"blur_px": round(blur, 2)}
    if blur <= limit_px:
        return Finding("picture.focus", State.OK, f"The picture is sharp to {blur:.1f} pixels.", "", numbers)
    return Finding(
        "picture.focus", State.BAD if blur > 2.0 * limit_px else State.ATTENTION,
        f"The picture is out of focus: edges are blurred over {blur:.1f} pixels.",
        "Turn the lens until the table's middle is sharp, or set the control focus in the bench file and "
        "switch the autofocus off; then calibrate again.", numbers,
    )  # fmt: skip


def judge_exposure(room: Image) -> Finding:
    bright = float(np.quantile(room, 0.95))
    clipped = float(np.mean(room.max(axis=2) >= _CLIPPED_GREY if room.ndim == 3 else room >= _CLIPPED_GREY))
    numbers = {
        "mean_grey": round(float(room.mean()), 1),
        "bright_grey": bright,
        "clipped_share": round(clipped, 4),
    }
    if clipped > _CLIPPED_SHARE:
        return Finding(
            "picture.exposure", State.ATTENTION,
            f"{100 * clipped:.0f} % of the picture is white: overexposed.",
            "Write a shorter exposure under [camera.texture] and [camera.board], or dim the room.", numbers,
            "white", {"percent": round(100 * clipped)},
        )  # fmt: skip
    if bright < _DARK_GREY:
        return Finding(
            "picture.exposure", State.ATTENTION,
            "The picture by the light of the room is dark: underexposed.",
            "Write a longer exposure under [camera.texture] and [camera.board], or light the room.", numbers,
            "dark",
        )  # fmt: skip
    return Finding(
        "picture.exposure", State.OK, "The picture is neither too dark nor too bright.", "", numbers
    )


def judge_noise(grey: float) -> Finding:
    numbers = {"noise_grey": round(grey, 2)}
    if grey <= _NOISY_GREY:
        return Finding(
            "picture.noise", State.OK, f"The picture's noise is {grey:.1f} grey levels.", "", numbers
        )
    return Finding(
        "picture.noise", State.ATTENTION, f"The picture is noisy: {grey:.1f} grey levels.",
        "Lower the control gain in the bench file, and expose longer instead.", numbers,
    )  # fmt: skip


def _judge_targets(exam: Examination) -> tuple[Finding, ...]:
    targets = targets_of(exam.bench.description)
    if not targets:
        return ()
    image = exam.picture(Use.BOARD).image(grey=True)
    found = [target for target in targets if target.find(image)]
    if not found:
        names = " nor ".join(f"the {target.name}" for target in targets)
        return (
            Finding(
                "picture.target", State.SKIPPED, f"Neither {names} can be seen." if len(targets) > 1
                else f"{names.capitalize()} cannot be seen.",
                "Put it where the camera sees all of it, and check what the bench file says of it.",
                values={"names": " / ".join(target.name for target in targets)},
            ),
        )  # fmt: skip
    count = sum(map(len, (found[0].find(image).values())))
    return (
        Finding(
            "picture.target", State.OK, f"The {found[0].name} can be seen: {count} corners.", "",
            {"corners": count}, values={"name": found[0].name},
        ),
    )  # fmt: skip
