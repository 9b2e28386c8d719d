"""Look-ahead planning as Grbl does it: blocks wait in a queue, and equal ways run through without a stop."""

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

from app.simulation.firmware.motion import Motion, Phase
from app.simulation.firmware.plant import Plant

# Grbl computes some segments of 10 ms ahead, so a hold takes effect so much later.
PREPARED_S = 0.0465


@dataclass(frozen=True, slots=True)
class Block:
    """A straight way from rest to rest, unless its neighbours go the same way.

    Attributes:
        start: steps of each axis where it begins.
        steps: to go on each axis, signed.
        length: in the machine's units.
        speed: at most, units/s.
        acceleration: units/s².
    """

    start: tuple[int, ...]
    steps: tuple[int, ...]
    length: float
    speed: float
    acceleration: float

    @property
    def end(self) -> tuple[int, ...]:
        return tuple(a + b for a, b in zip(self.start, self.steps, strict=True))

    def goes_on_in(self, other: "Block") -> bool:
        """Whether the other has the same direction, so that no speed is lost between them."""
        return all(
            math.isclose(a * other.length, b * self.length, rel_tol=1e-3, abs_tol=1e-6 * self.length)
            for a, b in zip(self.steps, other.steps, strict=True)
        )

    def at(self, way: float) -> tuple[float, ...]:
        """Steps of each axis after a part of the way, units."""
        return tuple(a + b * way / self.length for a, b in zip(self.start, self.steps, strict=True))


@dataclass(frozen=True, slots=True)
class _Stretch:
    block: Block
    phase: Phase


class Planner:
    """The queue of blocks, and the plant's motor that follows it.

    Attributes:
        size: blocks it has room for.
        end_s: when what has been started will stand; -inf when nothing has.
    """

    def __init__(self, plant: Plant, table_axis: int, axes: int, size: int) -> None:
        self.size, self.end_s = size, -math.inf
        self._plant, self._table_axis = plant, table_axis
        self._stood: tuple[int, ...] = (0,) * axes
        self._waiting: deque[Block] = deque()
        self._stretches: list[_Stretch] = []

    def room(self, now_s: float) -> int:
        """How many blocks may still be added."""
        return self.size - len(self._pending(now_s))

    @property
    def target(self) -> tuple[int, ...]:
        """Where everything that has been added will end, steps."""
        if self._waiting:
            return self._waiting[-1].end
        return self._stretches[-1].block.end if self._stretches else self._stood

    def is_waiting(self) -> bool:
        """Whether blocks wait to be started."""
        return bool(self._waiting)

    def is_moving(self, now_s: float) -> bool:
        return now_s < self.end_s

    def next_end_s(self, now_s: float) -> float:
        """When the block under way will be done; infinite when none is."""
        current = self._pending(now_s)[:1]
        return next(
            (piece.phase.end_s for piece in reversed(self._stretches) if piece.block in current), math.inf
        )

    def position(self, now_s: float) -> tuple[int, ...]:
        """Pulses given to each axis."""
        if not self._stretches:
            return self._stood
        piece = self._stretch_at(now_s)
        return tuple(round(at) for at in piece.block.at(piece.phase.position_at(now_s)))

    def speed(self, now_s: float) -> float:
        """Along the way, units/s."""
        if not self._stretches or now_s >= self.end_s:
            return 0.0
        return self._stretch_at(now_s).phase.speed_at(now_s)

    def add(self, block: Block, now_s: float) -> None:
        """Behind all others; the way under way is planned anew."""
        if not any(block.steps):
            return
        self._waiting.append(block)
        if self.is_moving(now_s):
            self._plan(now_s)

    def start(self, now_s: float) -> None:
        """Begin what waits, from rest."""
        self._settle(now_s)
        if self._waiting:
            self._plan(now_s)

    def hold(self, now_s: float) -> None:
        """Brake along the way; what is left of it waits for `start`."""
        if not self.is_moving(now_s):
            return
        at_s = min(now_s + PREPARED_S, self.end_s)
        left = self._pending(at_s)
        kept = [piece for piece in self._stretches if piece.phase.start_s < at_s]
        if not left:
            return
        way, speed = self._progress(at_s)
        kept[-1] = _Stretch(kept[-1].block, _shortened(kept[-1].phase, at_s))
        while left:
            block = left[0]
            needed = speed * speed / (2.0 * block.acceleration)
            room = block.length - way
            duration = speed / block.acceleration
            if needed >= room:
                after = math.sqrt(max(0.0, speed * speed - 2.0 * block.acceleration * room))
                duration = (speed - after) / block.acceleration
            kept.append(_Stretch(block, Phase(at_s, way, speed, -block.acceleration, duration)))
            at_s += duration
            if needed < room:
                way += needed
                break
            speed, way = after, 0.0
            left.pop(0)
        self._stretches, self.end_s = kept, at_s
        self._waiting = deque(left)
        if left:
            self._split(left[0], way, at_s)
        self._show(is_new=False)

    def cut(self, now_s: float) -> None:
        """Stop at once, on the last pulse given, and forget what waits."""
        if self.is_moving(now_s):
            stood = self.position(now_s)
            kept = [piece for piece in self._stretches if piece.phase.start_s < now_s]
            kept = kept or self._stretches[:1]
            kept[-1] = _Stretch(kept[-1].block, _shortened(kept[-1].phase, now_s))
            self._stretches = kept
            self._end_on(stood, now_s)
            self._show(is_new=False)
        self._settle(now_s)
        self._waiting.clear()

    def forget(self) -> None:
        """Position zero, nothing to do: power has come on. The plant is left to its owner."""
        self._stood = (0,) * len(self._stood)
        self._waiting.clear()
        self._stretches, self.end_s = [], -math.inf

    def _pending(self, now_s: float) -> list[Block]:
        """Blocks that are not done, the one under way first."""
        found: list[Block] = []
        for piece in self._stretches:
            if piece.phase.end_s > now_s and (not found or found[-1] is not piece.block):
                found.append(piece.block)
        return found + list(self._waiting)

    def _progress(self, now_s: float) -> tuple[float, float]:
        """Way and speed in the block under way."""
        piece = self._stretch_at(now_s)
        return piece.phase.position_at(now_s), piece.phase.speed_at(now_s)

    def _stretch_at(self, now_s: float) -> _Stretch:
        return next((piece for piece in self._stretches if now_s < piece.phase.end_s), self._stretches[-1])

    def _settle(self, now_s: float) -> None:
        """Forget a way that is over."""
        if self._stretches and now_s >= self.end_s:
            self._stood, self._stretches, self.end_s = self.position(now_s), [], -math.inf

    def _plan(self, now_s: float) -> None:
        is_new = not self._stretches
        blocks = self._pending(now_s)
        way, speed = (0.0, 0.0) if is_new else self._progress(now_s)
        kept = [piece for piece in self._stretches if piece.phase.start_s < now_s]
        if kept:
            kept[-1] = _Stretch(kept[-1].block, _shortened(kept[-1].phase, now_s))
        lengths = [block.length for block in blocks]
        lengths[0] = max(0.0, lengths[0] - way)
        speeds = _junction_speeds(blocks, lengths, speed)
        at_s, at = now_s, way
        for number, block in enumerate(blocks):
            for phase in _profile(
                at_s, at, lengths[number], speeds[number], speeds[number + 1], block.speed, block.acceleration
            ):
                kept.append(_Stretch(block, phase))
                at_s = phase.end_s
            at = 0.0
        self._stretches, self.end_s = kept, at_s
        self._waiting.clear()
        self._show(is_new=is_new)

    def _split(self, block: Block, way: float, at_s: float) -> None:
        """A block in which the way stopped: stand on a whole pulse, and keep what is left of it."""
        stood = tuple(round(at) for at in block.at(way))
        steps = tuple(end - at for end, at in zip(block.end, stood, strict=True))
        self._waiting.popleft()
        if any(steps):
            left = Block(stood, steps, block.length - way, block.speed, block.acceleration)
            self._waiting.appendleft(left)
        self._end_on(stood, at_s)

    def _end_on(self, stood: tuple[int, ...], at_s: float) -> None:
        here = Block(stood, (0,) * len(stood), 1.0, 1.0, 1.0)
        self._stretches.append(_Stretch(here, Phase(at_s, 0.0, 0.0, 0.0, 0.0)))
        self.end_s = at_s

    def _show(self, *, is_new: bool) -> None:
        motion = Motion(tuple(self._table_phases()))
        if is_new:
            self._plant.move(motion)
        else:
            self._plant.replan(motion)

    def _table_phases(self) -> Iterable[Phase]:
        """The table's pulses; a last phase puts it on a whole one, as a motor does."""
        axis = self._table_axis
        for piece in self._stretches:
            block, phase = piece.block, piece.phase
            scale = block.steps[axis] / block.length
            yield Phase(
                phase.start_s,
                block.at(phase.position)[axis],
                phase.speed * scale,
                phase.acceleration * scale,
                phase.duration_s,
            )
        yield Phase(self.end_s, round(block.at(phase.position_at(self.end_s))[axis]), 0.0, 0.0, 0.0)


def _shortened(phase: Phase, end_s: float) -> Phase:
    return Phase(
        phase.start_s,
        phase.position,
        phase.speed,
        phase.acceleration,
        max(0.0, min(phase.duration_s, end_s - phase.start_s)),
    )


def _junction_speeds(blocks: list[Block], lengths: list[float], first: float) -> list[float]:
    """Speeds at the start of each block and at the very end, by a pass backward and one forward."""
    speeds = [first]
    for before, after in pairwise(blocks):
        speeds.append(min(before.speed, after.speed) if before.goes_on_in(after) else 0.0)
    speeds.append(0.0)
    for number in range(len(blocks) - 1, 0, -1):
        reach = speeds[number + 1] ** 2 + 2.0 * blocks[number].acceleration * lengths[number]
        speeds[number] = min(speeds[number], math.sqrt(reach))
    for number, block in enumerate(blocks):
        reach = speeds[number] ** 2 + 2.0 * block.acceleration * lengths[number]
        speeds[number + 1] = min(speeds[number + 1], math.sqrt(reach))
    return speeds


def _profile(
    start_s: float, start: float, length: float, entry: float, leave: float, speed: float, rate: float
) -> Iterable[Phase]:
    """Up, along and down over a length."""
    peak = max(entry, leave, min(speed, math.sqrt((2.0 * rate * length + entry**2 + leave**2) / 2.0)))
    up, down = (peak**2 - entry**2) / (2.0 * rate), (peak**2 - leave**2) / (2.0 * rate)
    at_s, at = start_s, start
    for from_speed, slope, duration in (
        (entry, rate, (peak - entry) / rate),
        (peak, 0.0, max(0.0, length - up - down) / peak if peak else 0.0),
        (peak, -rate, (peak - leave) / rate),
    ):
        phase = Phase(at_s, at, from_speed, slope, duration)
        yield phase
        at_s, at = phase.end_s, phase.position_at(phase.end_s)
