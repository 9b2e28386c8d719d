"""Each laser alone: whether it lights and goes out, which it is, where its stripe falls, its colour."""

import math
from collections.abc import Sequence

import numpy as np

from app.checkup.examination import Examination, LaserLook, brings_light, stripe_of
from app.checkup.finding import Finding, State
from app.devices.bench_file import LaserEntry
from app.geometry.arrays import Floats
from app.geometry.rig import Rig
from app.vision.stripe import LaserStripe

_ALWAYS_ON_SHARE = 0.25
# Half of the picture's width, about its middle, is where the axis is looked for.
_MIDDLE_SHARE = 0.25
_FEWEST_ROWS = 20
_COLOURS = ("blue", "green", "red")
_CLEARLY = 1.3
_AROUND_PX = 8
_ON_PLANE_MM = 2.0
_TABLE_SHARE, _OTHERS_SHARE = 0.1, 3.0


def measure_lasers(exam: Examination) -> tuple[Finding, ...]:
    """Every laser of the bench file, and which is which."""
    if not exam.bench.lasers:
        return (
            Finding(
                "lasers.none", State.SKIPPED, "The bench file names no laser.",
                "Add a [[lasers]] table with name, channel and colour for each.", kind="unnamed",
            ),
        )  # fmt: skip
    if not exam.switches_lasers:
        return (
            Finding(
                "lasers.none", State.SKIPPED, "No board switches the lasers: they were not measured.",
                kind="unswitched",
            ),
        )  # fmt: skip
    channels = exam.bench.turntable.facts.laser_channels
    findings = [
        _no_output(entry, channels) for entry in exam.bench.lasers.values() if entry.channel not in channels
    ]
    for look in exam.looks:
        findings.append(judge_light(look))
        if findings[-1].is_trouble:
            continue
        findings += [judge_place(look), *judge_colour(look)]
    lit = [look for look in exam.looks if look.is_lit]
    findings += judge_which(lit, _rig_of(exam))
    return tuple(findings)


def judge_light(look: LaserLook) -> Finding:
    """Whether it can be switched on, and off again."""
    name, numbers = look.entry.name, {"rows_share": round(look.share, 3)}
    # Another laser that cannot be put out flickers by its speckle; this one's own stripe goes or stays.
    goes_out = brings_light(look.lit, look.after, look.entry)
    if brings_light(look.after, look.dark, look.entry) and not goes_out:
        return _stays_on(look.entry, "stays-on", "stays on after it was switched off")
    if look.is_lit:
        return Finding(f"lasers.light.{name}", State.OK, f"Laser {name} lights and goes out.", "", numbers)
    if len(stripe_of(look.dark, None, look.entry)) >= _ALWAYS_ON_SHARE * len(look.dark):
        return _stays_on(look.entry, "always-on", "seems to be on all the time: switching it changes nothing")
    return Finding(
        f"lasers.light.{name}", State.BAD,
        f"Laser {name} does not light, or its light falls on nothing that the camera sees.",
        f"Check its plug and its channel ({look.entry.channel}) in the bench file, and turn it to the "
        "table's middle; in bright light make the room darker.", numbers, "dark",
        {"channel": look.entry.channel},
    )  # fmt: skip


def judge_place(look: LaserLook) -> Finding:
    """Where the stripe falls in the picture."""
    name, width = look.entry.name, look.lit.shape[1]
    columns = look.stripe.pixels[:, 0]
    low, high = np.percentile(columns, [2.0, 98.0])
    in_middle = float(np.mean(np.abs(columns - 0.5 * width) < _MIDDLE_SHARE * width))
    numbers = {
        "first_column": round(float(low)), "last_column": round(float(high)),
        "rows": len(look.stripe), "in_middle_share": round(in_middle, 3),
    }  # fmt: skip
    sentence = f"The stripe of laser {name} falls on columns {low:.0f} to {high:.0f} of {width}"
    if in_middle > 0.5:
        return Finding(f"lasers.place.{name}", State.OK, f"{sentence}.", "", numbers, values={"width": width})
    return Finding(
        f"lasers.place.{name}", State.ATTENTION, f"{sentence}, beside the middle of the picture.",
        "Turn the laser so that its stripe runs through the table's middle, and the camera so that this is "
        "in the middle of the picture.", numbers, values={"width": width},
    )  # fmt: skip


def judge_colour(look: LaserLook) -> tuple[Finding, ...]:
    """The channel that gains most, against the bench file; nothing where that leaves it open."""
    name, said = look.entry.name, look.entry.colour
    if said == "any" or look.lit.ndim == 2:
        return ()
    gains = _gains(look)
    seen = _COLOURS[int(np.argmax(gains))]
    numbers = {f"{colour}_gain": round(float(gain), 1) for colour, gain in zip(_COLOURS, gains, strict=True)}
    if seen == said or gains.max() < _CLEARLY * gains[_COLOURS.index(said)]:
        sentence = f"Laser {name} is {said}."
        values = {"said": said}
        return (Finding(f"lasers.colour.{name}", State.OK, sentence, "", numbers, values=values),)
    return (
        Finding(
            f"lasers.colour.{name}", State.ATTENTION,
            f"Laser {name} looks {seen}; the bench file says {said}.",
            f'Write colour = "{seen}" for it, or "any" where the camera shows colours wrongly.', numbers,
            values={"seen": seen, "said": said},
        ),
    )  # fmt: skip


def judge_which(lit: Sequence[LaserLook], rig: Rig | None) -> list[Finding]:
    """Which is which: by the calibration's planes where the bare table shows them, else by their names."""
    if rig is not None:
        finding = _by_planes(lit, rig)
        if finding is not None:
            return [finding]
    found = _by_names(lit)
    return [] if found is None else [found]


def leftness_px(one: LaserStripe, other: LaserStripe) -> float:
    """How far one stripe lies left of another where both are near the camera; NaN where rows do not tell.

    The part of a stripe that is low in the picture is this side of the axis, where a laser's light lies
    on the laser's own side.
    """
    rows, first, second = np.intersect1d(one.line, other.line, return_indices=True)
    if len(rows) < _FEWEST_ROWS:
        return math.nan
    lower = slice(len(rows) // 2, None)
    return float(np.median(other.pixels[second[lower], 0] - one.pixels[first[lower], 0]))


def _by_names(lit: Sequence[LaserLook]) -> Finding | None:
    left = next((look for look in lit if "left" in look.entry.name.lower()), None)
    right = next((look for look in lit if "right" in look.entry.name.lower()), None)
    if len(lit) == 2 and (left is None or right is None):
        one, other = lit
        apart = leftness_px(one.stripe, other.stripe)
        if not math.isfinite(apart):
            return None
        names = [look.entry.name for look in ((one, other) if apart > 0.0 else (other, one))]
        return Finding(
            "lasers.which", State.OK, f"Laser {names[0]} stands left, laser {names[1]} right.", "",
            {"apart_px": round(abs(apart), 1)}, "sides", {"left": names[0], "right": names[1]},
        )  # fmt: skip
    if left is None or right is None:
        return None
    apart = leftness_px(left.stripe, right.stripe)
    if not math.isfinite(apart):
        return Finding(
            "lasers.which", State.SKIPPED, "The two stripes share too few rows to tell left from right.",
            "Put an upright thing on the table's middle.",
        )  # fmt: skip
    numbers = {"left_is_left_by_px": round(apart, 1)}
    if apart > 0.0:
        sentence = f"Laser {left.entry.name} stands left, laser {right.entry.name} right."
        sides = {"left": left.entry.name, "right": right.entry.name}
        return Finding("lasers.which", State.OK, sentence, "", numbers, "sides", sides)
    return _swapped(
        left.entry, right.entry, f"The light of laser {left.entry.name} lies right of that of laser "
        f"{right.entry.name}: the lasers are swapped, or the pictures mirrored.", numbers,
    )  # fmt: skip


def _by_planes(lit: Sequence[LaserLook], rig: Rig) -> Finding | None:
    """Compare the light on the bare table with every calibrated plane; None where that does not tell."""
    known = [look for look in lit if look.entry.name in rig.lasers]
    if len(known) < 2 or not math.isfinite(rig.axis.offset_mm):
        return None
    best: dict[str, str] = {}
    numbers: dict[str, float] = {}
    for look in known:
        shares = {name: _share_on_plane(look.stripe, rig, name) for name in rig.lasers}
        fits = max(shares, key=lambda name: shares[name])
        own = shares[look.entry.name]
        if shares[fits] < _TABLE_SHARE:
            return None
        numbers |= {f"{look.entry.name}_on_{name}": round(share, 3) for name, share in shares.items()}
        best[look.entry.name] = fits if shares[fits] > _OTHERS_SHARE * own else look.entry.name
    wrong = {name: fits for name, fits in best.items() if fits != name}
    if not wrong:
        return Finding(
            "lasers.which", State.OK, "Every laser lies in the plane that its calibration says.", "", numbers,
            "planes",
        )  # fmt: skip
    name, fits = next(iter(wrong.items()))
    entries = {look.entry.name: look.entry for look in known}
    if wrong.get(fits) == name:
        sentence = (
            f"Lasers {name} and {fits} each light the other's calibrated plane: the lasers are swapped."
        )
        return _swapped(entries[name], entries[fits], sentence, numbers)
    return Finding(
        "lasers.which", State.BAD, f"Laser {name} lights the calibrated plane of laser {fits}.",
        "Check the channels in the bench file, or calibrate again.", numbers, "other-plane",
        {"laser": name, "other": fits},
    )  # fmt: skip


def _share_on_plane(stripe: LaserStripe, rig: Rig, laser: str) -> float:
    """Of a stripe's points, those that lie on a laser's plane if they lie on the table's top."""
    table_from_camera = rig.axis.table_from_camera(0.0)
    eye, rays = table_from_camera.translation, rig.camera.rays(stripe.pixels) @ table_from_camera.rotation.T
    on_table = eye - (eye[2] / rays[:, 2])[:, None] * rays
    off_mm = rig.lasers[laser].signed_distance(rig.axis.camera_from_table @ on_table)
    return float(np.mean(np.abs(off_mm) < _ON_PLANE_MM))


def _gains(look: LaserLook) -> Floats:
    """(3,) grey levels by which blue, green and red gain in the stripe and beside it."""
    rows = look.stripe.line
    gains = np.zeros(3)
    for off in range(-_AROUND_PX, _AROUND_PX + 1):
        columns = np.clip(np.rint(look.stripe.pixels[:, 0]).astype(int) + off, 0, look.lit.shape[1] - 1)
        gains += look.lit[rows, columns].astype(float).mean(axis=0) - look.dark[rows, columns].mean(axis=0)
    mean: Floats = gains / (2 * _AROUND_PX + 1)
    return mean


def _rig_of(exam: Examination) -> Rig | None:
    """The calibrated rig, where it is whole and for pictures of this size."""
    record = exam.calibration
    if record is None or record.axis is None or not record.lasers:
        return None
    return record.rig if record.camera.size == exam.bench.camera.facts.size else None


def _swapped(left: LaserEntry, right: LaserEntry, sentence: str, numbers: dict[str, float]) -> Finding:
    return Finding(
        "lasers.which", State.BAD, sentence,
        f"Exchange their channels in the bench file: {left.name} gets channel = {right.channel}, "
        f"{right.name} channel = {left.channel}; or exchange the plugs.", numbers, "swapped",
        {"left": left.name, "right": right.name, "channel": right.channel, "other_channel": left.channel},
    )  # fmt: skip


def _stays_on(entry: LaserEntry, kind: str, what: str) -> Finding:
    return Finding(
        f"lasers.light.{entry.name}", State.BAD, f"Laser {entry.name} {what}.",
        "Unplug it, do not look into it, and check its wiring: it should hang on the board's switched output "
        f"{entry.channel}, not on the supply.", kind=kind, values={"channel": entry.channel},
    )  # fmt: skip


def _no_output(entry: LaserEntry, channels: Sequence[int]) -> Finding:
    has = ", ".join(map(str, channels)) or "none"
    return Finding(
        f"lasers.channel.{entry.name}", State.BAD,
        f"Laser {entry.name} is to hang on channel {entry.channel}, which the board does not have.",
        f"Write one of its channels into the bench file: {has}.", {"channel": entry.channel},
        values={"has": has},
    )  # fmt: skip
