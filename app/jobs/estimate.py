"""What a scan will take before it is begun: time, pictures, points, room on the disk."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from app.devices.bench import Bench
from app.errors import NoRoom
from app.jobs.job import JobSnapshot
from app.library.library import free_bytes
from app.scanning.plan import ScanPlan
from app.scanning.session import ScanSession

# Where nothing was measured yet.
_USUAL_SPEED_DEG_S = 45.0
_START_AND_STOP_S = 0.25
_PERIODS_PER_PICTURE = 3.0
_USUAL_FPS = 15.0
_USUAL_SIZE = (1280, 720)
_JPEG_BYTES_PER_PIXEL, _PNG_BYTES_PER_PIXEL = 0.25, 1.5
_LIT_PART = 0.35
_COMPUTING_S_PER_MEGAPIXEL = 0.06
_POINT_BYTES = 40
# Left free on the disk, for everything else.
_RESERVE_BYTES = 64 << 20


@dataclass(frozen=True, slots=True)
class ScanEstimate:
    """What a scan is about to take.

    Attributes:
        seconds: until its cloud is there.
        capture_s: of these, until the last picture.
        shots: pictures that are taken.
        points: of the cloud.
        size_bytes: on the disk.
        is_measured: as the last scan of this kind went; otherwise from what the bench says of itself.
    """

    seconds: float
    capture_s: float
    shots: int
    points: int
    size_bytes: int
    is_measured: bool


class Pace(BaseModel):
    """How a scan went, kept in the result of its job for the estimates of later ones.

    Attributes:
        mode, size: what pace it is: of another mode, or other pictures, it says nothing.
        shots: pictures that this job took.
        lit: of the whole scan, with a laser on.
        stack: how many of these show the same, with other exposures.
        capture_s: without rests and waits.
        computing_s: of the cloud.
        bytes_per_shot: on the disk.
        points: of the cloud.
    """

    model_config = ConfigDict(frozen=True, allow_inf_nan=False)

    mode: str
    size: tuple[int, int]
    shots: int
    lit: int
    stack: int = 1
    capture_s: float
    computing_s: float = 0.0
    bytes_per_shot: float
    points: int = 0


def estimate(plan: ScanPlan, bench: Bench, earlier: Iterable[JobSnapshot]) -> ScanEstimate:
    """What the plan will take on this bench.

    Args:
        plan: see there.
        bench: what it says of itself is used as far as it is connected.
        earlier: jobs, newest first; how the last scan of this kind went counts more than what devices say.
    """
    size, fps = _picture_facts(bench)
    shots, lit = _shots(plan, fps)
    pace = next((p for p in map(_pace, earlier) if p and (p.mode, p.size) == (plan.mode, size)), None)
    if plan.mode == "continuous":
        capture_s = sum(
            (plan.turn_deg + 3.0 * plan.run_in_deg) / plan.speed_deg_s + _START_AND_STOP_S
            for _ in plan.passes
        )
    elif pace is not None and pace.shots:
        capture_s = shots * pace.capture_s / pace.shots
    else:
        capture_s = _steps_s(plan, bench, fps)
    stack = max(1, len(plan.exposures_us))
    if pace is not None and pace.shots:
        computing_s = lit * pace.computing_s / max(pace.lit, 1)
        points = lit * pace.points * pace.stack // (stack * max(pace.lit, 1))
        per_shot = pace.bytes_per_shot
    else:
        pixels = size[0] * size[1]
        computing_s = shots * _COMPUTING_S_PER_MEGAPIXEL * pixels * 1e-6
        points = round(lit / stack * _LIT_PART * max(size))
        is_jpeg = (
            plan.mode == "continuous" or not bench.camera.state.is_connected or bench.camera.facts.gives_jpeg
        )
        per_shot = pixels * (_JPEG_BYTES_PER_PIXEL if is_jpeg else _PNG_BYTES_PER_PIXEL)
    return ScanEstimate(
        capture_s + computing_s, capture_s, shots, points, round(shots * per_shot + points * _POINT_BYTES),
        pace is not None,
    )  # fmt: skip


def pace_of(session: ScanSession, shots_before: int, capture_s: float) -> Pace:
    """How the pictures of a scan went that has been taken."""
    entries = session.writer.entries
    files = [session.folder / entry.file for entry in entries[-200:]]
    return Pace(
        mode=session.plan.mode,
        size=session.writer.header.camera_size,
        shots=session.shots - shots_before,
        lit=sum(bool(entry.lasers_on) for entry in entries),
        stack=max(1, len(session.plan.exposures_us)),
        capture_s=capture_s,
        bytes_per_shot=sum(path.stat().st_size for path in files) / max(len(files), 1),
    )


def refuse_without_room(wanted: ScanEstimate, folder: Path) -> None:
    """Compare what a scan will take with the room on the disk of a folder.

    Raises:
        NoRoom: with both numbers.
    """
    free = free_bytes(folder)
    if wanted.size_bytes + _RESERVE_BYTES > free:
        raise NoRoom(str(folder), wanted.size_bytes, free)


def _shots(plan: ScanPlan, fps: float) -> tuple[int, int]:
    """How many pictures, and how many of them with a laser on."""
    if plan.mode == "step":
        looks = [look for stop in range(plan.steps) for look in plan.looks(stop)]
        return len(looks), sum(bool(look.lasers) for look in looks)
    of_a_turn = math.ceil(fps * plan.turn_deg / plan.speed_deg_s)
    return of_a_turn * len(plan.passes), of_a_turn * sum(bool(look.lasers) for look in plan.passes)


def _steps_s(plan: ScanPlan, bench: Bench, fps: float) -> float:
    fastest = bench.turntable.facts.fastest_deg_s if bench.turntable.is_connected else math.inf
    speed = fastest if 0.0 < fastest < math.inf else _USUAL_SPEED_DEG_S
    move_s = _START_AND_STOP_S + plan.turn_deg / plan.steps / speed
    # A sensor takes over a new exposure a picture late.
    periods = plan.shots * _PERIODS_PER_PICTURE + plan.steps * len(plan.exposures_us)
    return plan.steps * (move_s + bench.description.turntable.settle_s) + periods / fps


def _picture_facts(bench: Bench) -> tuple[tuple[int, int], float]:
    if not bench.camera.state.is_connected:
        return _USUAL_SIZE, _USUAL_FPS
    facts = bench.camera.facts
    return facts.size, facts.fps if facts.fps > 0.0 else _USUAL_FPS


def _pace(job: JobSnapshot) -> Pace | None:
    told: Any = job.result.get("pace") if isinstance(job.result, Mapping) else None
    try:
        return Pace.model_validate(told)
    except ValidationError:
        return None
