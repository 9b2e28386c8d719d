"""The computer: room for scans, how fast it writes, and whether it keeps up with the camera."""

import os
import shutil
import tempfile
import time
from pathlib import Path

from app.checkup.examination import Examination, stripe_of
from app.checkup.finding import Finding, State
from app.devices.frame import Use
from app.files import reason
from app.scanning.plan import ScanPlan

_WRITTEN_BYTES = 16_000_000
_LEAST_SCANS = 2
_PLENTY_SCANS = 10
_SPEED_MARGIN = 1.5
_TIMED = 3


def measure_machine(exam: Examination) -> tuple[Finding, ...]:
    """Disk and pace, for pictures as this camera makes them."""
    frame = exam.picture(Use.LASER)
    data = frame.encoded()
    fps = exam.bench.camera.state.fps or exam.bench.camera.facts.fps
    plan = ScanPlan(lasers=tuple(exam.bench.lasers) or ("laser",))
    speed, problem = write_speed(exam.folder, data)
    if problem:
        return (
            Finding(
                "machine.folder", State.BAD, f"Scans cannot be written to {exam.folder}: {problem}.",
                "Run the command in a folder that is yours, or change its permissions.",
                values={"folder": str(exam.folder), "problem": problem},
            ),
        )  # fmt: skip
    return (
        judge_space(shutil.disk_usage(exam.folder).free, len(data) * plan.shots),
        judge_speed(speed, len(data) * fps),
        judge_pace(_look_s(exam), 1.0 / fps if fps else 0.0),
    )


def write_speed(folder: Path, data: bytes) -> tuple[float, str]:
    """Bytes per second that reach the disk in a folder, and what keeps them from it."""
    count = max(1, _WRITTEN_BYTES // len(data))
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            began_s = time.perf_counter()
            for _ in range(count):
                file.write(data)
            file.flush()
            os.fsync(file.fileno())
            return count * len(data) / max(time.perf_counter() - began_s, 1e-6), ""
    except OSError as error:
        return 0.0, reason(error)


def judge_space(free: int, scan: int) -> Finding:
    """Args:
    free: bytes.
    scan: bytes of a scan with the default plan.
    """
    scans = free // max(scan, 1)
    numbers = {"free_bytes": free, "scan_bytes": scan, "scans": scans}
    sentence = f"{_size(free)} are free, a scan takes {_size(scan)}"
    if scans >= _PLENTY_SCANS:
        return Finding("machine.disk", State.OK, f"{sentence}.", "", numbers)
    return Finding(
        "machine.disk", State.BAD if scans < _LEAST_SCANS else State.ATTENTION,
        f"{sentence}: room for {scans} {'scan' if scans == 1 else 'scans'}.",
        "Free some space, or scan into a folder on another disk.", numbers,
    )  # fmt: skip


def judge_speed(speed: float, needed: float) -> Finding:
    """Args:
    speed, needed: bytes per second, written and to be written in a continuous scan.
    """
    numbers = {"written_bytes_s": round(speed), "needed_bytes_s": round(needed)}
    sentence = f"The disk takes {_size(speed)} a second, a continuous scan makes {_size(needed)}"
    if speed >= _SPEED_MARGIN * needed:
        return Finding("machine.speed", State.OK, f"{sentence}.", "", numbers)
    return Finding(
        "machine.speed", State.ATTENTION, f"{sentence}: the disk is too slow for it.",
        "Scan step by step, or into a folder on a faster disk; a camera that gives JPEG needs less.", numbers,
    )  # fmt: skip


def judge_pace(look_s: float, period_s: float) -> Finding:
    """Args:
    look_s: to find the stripe in one picture, decoding included.
    period_s: from one picture to the next.
    """
    numbers = {"look_ms": round(1e3 * look_s, 1), "period_ms": round(1e3 * period_s, 1)}
    sentence = (
        f"Finding the stripe takes {1e3 * look_s:.0f} ms, a picture comes every {1e3 * period_s:.0f} ms"
    )
    kind = ""
    if look_s > period_s:
        kind = "slow"
        sentence += ": in a continuous scan only some points are shown live, and all are computed afterwards"
    return Finding("machine.pace", State.OK, f"{sentence}.", "", numbers, kind)


def _look_s(exam: Examination) -> float:
    """Seconds for one picture, the fastest of some; the first may still compile."""
    if not exam.bench.lasers:
        return 0.0
    entry = next(iter(exam.bench.lasers.values()))
    dark = exam.picture(Use.LASER).image()
    times = []
    for _ in range(_TIMED):
        frame = exam.picture(Use.LASER)
        began_s = time.perf_counter()
        stripe_of(frame.image(), dark, entry)
        times.append(time.perf_counter() - began_s)
    return min(times)


def _size(count: float) -> str:
    for unit in ("B", "kB", "MB", "GB"):
        if count < 1000.0:
            return f"{count:.3g} {unit}"
        count /= 1000.0
    return f"{count:.3g} TB"
