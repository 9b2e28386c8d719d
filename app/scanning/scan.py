"""The capture loop: pictures from the bench, each with what the rig did while it was taken."""

import math
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass

from app.devices.bench import Bench
from app.devices.frame import Frame, Use
from app.devices.frame_stream import FrameStream
from app.devices.turntable import Turntable
from app.errors import DeviceError, DeviceLost, MoveStopped, TurnBrokenOff
from app.scanning.exposure_stack import ExposureStack, exposure_stack
from app.scanning.pipeline import ordered_map
from app.scanning.plan import Look, ScanPlan
from app.scanning.steady_angle import SteadyAngle, follow

# A laser may stay lit no longer than this for a picture that does not come.
_PICTURE_S = 0.6
_PICTURE_PERIODS = 8.0
_DEVELOPERS = 2
# A steady turn with a longer hole in its pictures is taken up again before it.
_GAP_S = 0.25
_GAP_PERIODS = 6.0


@dataclass(frozen=True, eq=False, slots=True)
class Taken:
    """A picture as the bench gave it.

    Attributes:
        data: PNG or JPEG file.
        frame: where it is from.
        look: what it shows.
        stop: number of the stop; in a continuous scan, of the picture in its turn.
        angle_deg: table angle at the middle of its exposure, as told or counted.
        time_s: monotonic time of that.
        exposure_us: how long it was exposed, where known.
    """

    data: bytes
    frame: Frame
    look: Look
    stop: int
    angle_deg: float
    time_s: float
    exposure_us: float | None


def scan_steps(
    bench: Bench,
    plan: ScanPlan,
    is_taken: Callable[[int, Look], bool],
    before_move: Callable[[float], None],
) -> Generator[Taken, None, None]:
    """One turn in stops; at each one the table stands still while the pictures are exposed.

    Args:
        bench: held by the caller, connected.
        plan: see there.
        is_taken: whether a picture of a stop is there already; those are passed over.
        before_move: told where the table is about to go.

    Raises:
        DeviceError: a device failed; the lasers are off, and the same call goes on where this one ended.
    """
    bench.turntable.hold(True)
    is_always_lit = all(look.lasers == plan.lasers for look in plan.looks(0))
    stays_lit = bench.turntable.facts.lasers_by_hand and is_always_lit
    with (
        exposure_stack(bench.camera, plan.exposures_us) as stack,
        bench.lit(*plan.lasers) if stays_lit else nullcontext(),
    ):
        for stop in range(plan.steps):
            looks = [look for look in plan.looks(stop) if not is_taken(stop, look)]
            if not looks:
                continue
            before_move(plan.angle_deg(stop))
            angle_deg = bench.turntable.move_to(plan.angle_deg(stop))
            time.sleep(bench.description.turntable.settle_s)
            for look in looks:
                frame = _photographed(bench, stack, look, is_lit=stays_lit)
                exposure_us = stack.exposure_us(look, frame)
                yield Taken(frame.encoded(), frame, look, stop, angle_deg, _middle_s(frame), exposure_us)


def scan_steadily(
    bench: Bench,
    plan: ScanPlan,
    reached_deg: Callable[[Look], float | None],
    before_move: Callable[[float], None],
) -> Generator[Taken, None, None]:
    """One steady turn for each laser, every frame of the camera with its angle by time.

    Args:
        bench: held by the caller, connected.
        plan: see there.
        reached_deg: angle within a turn of the last picture that is there; None for none.
        before_move: told where the table is about to go.

    Raises:
        DeviceError: as `scan_steps`.
    """
    bench.turntable.hold(True)
    for number, look in enumerate(plan.passes):
        done_deg = reached_deg(look)
        if done_deg is not None and done_deg >= plan.turn_deg:
            continue
        begins_deg = number * plan.turn_deg
        from_deg = begins_deg + (0.0 if done_deg is None else done_deg)
        yield from _one_turn(bench, plan, look, begins_deg, from_deg, before_move)


def _one_turn(
    bench: Bench,
    plan: ScanPlan,
    look: Look,
    begins_deg: float,
    from_deg: float,
    before_move: Callable[[float], None],
) -> Generator[Taken, None, None]:
    table, camera = bench.turntable, bench.camera
    camera.prepare(Use.LASER if look.lasers else Use.TEXTURE)
    start_deg, ends_deg = from_deg - plan.run_in_deg, begins_deg + plan.turn_deg
    if not table.facts.turns_by_itself:
        before_move(start_deg)
        table.move_to(start_deg)
        before_move(ends_deg + plan.run_in_deg)
    with camera.stream(patience_s=_PICTURE_S) as stream, bench.lit(*look.lasers):
        turn = table.start_turning(ends_deg + plan.run_in_deg - start_deg, plan.speed_deg_s)
        with _stopped_early(table), follow(table, turn) as angle:
            if table.facts.turns_by_itself:
                # It has turned on meanwhile: the same place comes by again, some turns later.
                angle.offset_deg -= 360.0 * math.ceil((table.angle_deg - start_deg) / 360.0)
            wanted = _between(bench, stream, angle, from_deg, ends_deg)
            developed = ordered_map(lambda frame: (frame, frame.encoded("jpeg")), wanted, _DEVELOPERS)
            try:
                for frame, data in developed:
                    middle_s = _middle_s(frame)
                    at_deg = angle.at(middle_s)
                    yield Taken(data, frame, look, frame.index, at_deg, middle_s, frame.exposure_us)
            finally:
                # Whatever ends it, no picture is waited for any more before the lasers go off.
                stream.end()
                developed.close()
    if not table.facts.turns_by_itself:
        table.finish_turning()


@contextmanager
def _stopped_early(table: Turntable) -> Iterator[None]:
    """A turn that is broken off is stopped first: many boards switch no laser while they turn."""
    try:
        yield
    except BaseException:
        if not table.facts.turns_by_itself:
            with suppress(DeviceError):
                table.stop()
        raise


def _between(
    bench: Bench, stream: FrameStream, angle: SteadyAngle, from_deg: float, ends_deg: float
) -> Iterator[Frame]:
    """The frames of a turn; `from_deg` itself is not wanted again where it was the last picture before."""
    longest_gap_s = max(_GAP_S, _GAP_PERIODS / max(bench.camera.facts.fps, 1.0))
    before_s: float | None = None
    stops = bench.stops
    for frame in stream:
        if not bench.turntable.is_connected:
            raise DeviceLost(bench.description.turntable.driver, "the board has gone in mid-turn")
        if bench.stops != stops:
            raise MoveStopped(bench.description.turntable.driver, "the turn was stopped")
        # Ended here, the turn is taken up again at the last picture before the gap.
        if stream.lost:
            raise TurnBrokenOff(bench.camera.name, "pictures came faster than they could be kept")
        middle_s = _middle_s(frame)
        if before_s is not None and middle_s - before_s > longest_gap_s:
            raise TurnBrokenOff(bench.camera.name, f"gave no picture for {middle_s - before_s:.1f} s")
        before_s, at_deg = middle_s, angle.at(middle_s)
        if at_deg >= ends_deg:
            return
        if at_deg > from_deg and angle.is_steady(middle_s):
            yield frame


def _photographed(bench: Bench, stack: ExposureStack, look: Look, *, is_lit: bool) -> Frame:
    stack.prepare(look)
    timeout_s = _PICTURE_S + _PICTURE_PERIODS / max(bench.camera.facts.fps, 1.0)
    with nullcontext() if is_lit else bench.lit(*look.lasers):
        return stack.fresh_frame(look, timeout_s)


def _middle_s(frame: Frame) -> float:
    return frame.exposed_s + 0.5e-6 * (frame.exposure_us or 0.0)
