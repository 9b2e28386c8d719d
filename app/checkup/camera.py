"""When pictures come: rate, latency, time stamps, and old ones that come first."""

import numpy as np

from app.checkup.examination import Examination
from app.checkup.finding import Finding, State
from app.checkup.latency import Latency, first_signal, measure_latency, measure_stale
from app.checkup.raw_camera import Arrival, RawReader, period_of, raw_reader
from app.devices.bench import Bench
from app.devices.camera_driver import CameraFacts

_COUNTED = 30
_SLOW_SHARE = 0.85
# What a usual camera takes, in seconds and in periods.
_USUAL_LATENCY_S, _USUAL_PERIODS = 0.095, 2.5
_LATENCY_TOLERANCE_S = 0.012


def measure_camera(exam: Examination) -> tuple[Finding, ...]:
    """Rate, latency, time stamps and stale pictures, read from the driver itself.

    Afterwards the bench's camera reckons with the latency that was found, whatever its file says.
    """
    bench = exam.bench
    with raw_reader(bench) as reader:
        exam.tell("counting pictures")
        arrivals = [reader.grab() for _ in range(_COUNTED)]
        period_s = period_of(arrivals[2:])
        findings = [judge_rate(reader.driver.facts, 1.0 / period_s), judge_frozen(reader, arrivals)]
        exam.tell("latency and old pictures")
        timed = _timed(bench, reader, arrivals[-1], period_s) if exam.switches_lasers else None
        if timed is None:
            return (*findings, _no_signal())
        latency, stale = timed
        bench.camera.latency_s = latency.latency_s.high
        exam.patience_s = 0.0
    findings.append(judge_latency(latency, period_s, 1e-3 * bench.description.camera.latency_ms))
    return (*findings, judge_stamps(latency), judge_stale(stale))


def _timed(bench: Bench, reader: RawReader, dark: Arrival, period_s: float) -> tuple[Latency, int] | None:
    """Latency and stale pictures; None where no laser's light is seen."""
    found = first_signal(bench, reader, reader.image(dark))
    if found is None:
        return None
    laser, signal = found
    try:
        latency = measure_latency(bench, laser, signal, reader, period_s)
        if latency is None:
            return None
        return latency, measure_stale(bench, laser, signal, reader, period_s, latency.latency_s.high)
    finally:
        bench.switch(laser, False)


def judge_rate(facts: CameraFacts, fps: float) -> Finding:
    numbers = {"fps": round(fps, 2), "told_fps": round(facts.fps, 2)}
    if not facts.fps or fps >= _SLOW_SHARE * facts.fps:
        return Finding("camera.rate", State.OK, f"The camera gives {fps:.1f} pictures a second.", "", numbers)
    return Finding(
        "camera.rate", State.ATTENTION,
        f"The camera gives {fps:.1f} pictures a second instead of the {facts.fps:.1f} that it promises.",
        "Set a shorter exposure, choose the format MJPG or a smaller picture, and give the camera a USB port "
        "of its own.", numbers,
    )  # fmt: skip


def judge_frozen(reader: RawReader, arrivals: list[Arrival]) -> Finding:
    one, other = (reader.image(arrival) for arrival in arrivals[-2:])
    if not np.array_equal(one, other) or one.std() < 2.0:
        return Finding("camera.frozen", State.OK, "Every picture is a new one.")
    return Finding(
        "camera.frozen", State.BAD, "The camera sends the same picture again and again.",
        "Unplug it and plug it in again; close other programs that use it.",
    )  # fmt: skip


def judge_latency(latency: Latency, period_s: float, written_s: float) -> Finding:
    """Against what the bench file says, which matters for a camera that does not tell when it exposed."""
    is_timed = latency.late_stamps_s is not None
    taken_s = latency.latency_s.high
    numbers = {
        "latency_ms": round(1e3 * taken_s, 1),
        "at_least_ms": round(1e3 * max(0.0, latency.latency_s.low), 1),
        "command_ms": round(1e3 * latency.command_s, 1),
        "command_to_picture_ms": round(1e3 * latency.most_s, 1),
    }
    sentence = f"A picture arrives {1e3 * taken_s:.0f} ms after its exposure began"
    slack_s = max(_LATENCY_TOLERANCE_S, 0.5 * period_s)
    is_long = taken_s > max(_USUAL_LATENCY_S, _USUAL_PERIODS * period_s)
    write = f"Write latency_ms = {1e3 * taken_s:.0f} under [camera] in the bench file."
    if not is_timed and (taken_s > written_s + slack_s or taken_s < written_s - 2.0 * slack_s):
        return Finding(
            "camera.latency", State.ATTENTION,
            f"{sentence}, and the camera does not tell when it exposed; the bench file says "
            f"{1e3 * written_s:.0f} ms.", write, numbers, "untold", {"written_ms": round(1e3 * written_s)},
        )  # fmt: skip
    if is_long and is_timed:
        return Finding(
            "camera.latency", State.ATTENTION,
            f"{sentence}: a long latency. Pictures are right, for the camera tells their times, but every "
            "stop of a scan takes so much longer.",
            "A cable instead of a network, a smaller picture or the format MJPG make it shorter.", numbers,
            "long",
        )  # fmt: skip
    return Finding("camera.latency", State.OK, f"{sentence}.", "", numbers)


def judge_stamps(latency: Latency) -> Finding:
    if latency.late_stamps_s is None:
        return Finding(
            "camera.timestamps", State.OK,
            "The camera does not tell when it exposed; its latency stands in for that.", "", {"told": 0},
            "untold",
        )  # fmt: skip
    late_s, slack_s = latency.late_stamps_s.middle, latency.late_stamps_s.half_width
    numbers = {"told": 1, "late_ms": round(1e3 * late_s, 1), "uncertainty_ms": round(1e3 * slack_s, 1)}
    if latency.has_right_stamps:
        return Finding(
            "camera.timestamps", State.OK, "The camera tells when it exposed, and that is right.", "", numbers
        )
    way = "early" if late_s > 0.0 else "late"
    return Finding(
        "camera.timestamps", State.ATTENTION,
        f"The camera's time stamps are {1e3 * abs(late_s):.0f} ms too {way}.",
        "Scan step by step with a settle_s longer than that; continuous scans would be turned by as much.",
        numbers, way, {"off_ms": round(1e3 * abs(late_s))},
    )  # fmt: skip


def judge_stale(stale: int) -> Finding:
    numbers = {"stale_frames": stale}
    if not stale:
        return Finding("camera.stale", State.OK, "The first picture after a pause is a new one.", "", numbers)
    what = "one old picture" if stale == 1 else f"{stale} old pictures"
    return Finding(
        "camera.stale", State.ATTENTION,
        f"After a pause the camera first gives {what} from before it: stale frames.",
        "Turnscan reads all the time and is not misled. A program that reads only now and then must throw "
        f"{'it' if stale == 1 else 'them'} away; a smaller number of `buffers` in the bench file may help.",
        numbers,
    )  # fmt: skip


def _no_signal() -> Finding:
    return Finding(
        "camera.latency", State.SKIPPED,
        "No laser's light was seen, so latency and old pictures were not measured.",
        "See to the lasers first, or turn them towards something in view.",
    )  # fmt: skip
