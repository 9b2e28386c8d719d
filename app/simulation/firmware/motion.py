"""What a stepper motor does from when it is told to move until it stands."""

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Phase:
    """A stretch of constant acceleration.

    Attributes:
        start_s: when it begins.
        position: steps at its start.
        speed: steps/s at its start, signed.
        acceleration: steps/s², signed.
        duration_s: how long it lasts; infinite for a turn without end.
    """

    start_s: float
    position: float
    speed: float
    acceleration: float
    duration_s: float

    @property
    def end_s(self) -> float:
        return self.start_s + self.duration_s

    def position_at(self, time_s: float) -> float:
        t = min(max(time_s - self.start_s, 0.0), self.duration_s)
        return self.position + t * (self.speed + 0.5 * self.acceleration * t)

    def speed_at(self, time_s: float) -> float:
        return self.speed + self.acceleration * min(max(time_s - self.start_s, 0.0), self.duration_s)


@dataclass(frozen=True, slots=True)
class Motion:
    """One move: phases that follow each other without a gap.

    Attributes:
        phases: at least one.
    """

    phases: tuple[Phase, ...]

    @property
    def start_s(self) -> float:
        return self.phases[0].start_s

    @property
    def end_s(self) -> float:
        return self.phases[-1].end_s

    @property
    def from_steps(self) -> float:
        return self.phases[0].position

    @property
    def steps(self) -> float:
        """How far it goes, signed; infinite for a turn without end."""
        last = self.phases[-1]
        return (
            last.speed * math.inf
            if math.isinf(last.duration_s)
            else self.position_at(self.end_s) - self.from_steps
        )

    def position_at(self, time_s: float) -> float:
        """Steps at a time; before the move where it starts, after it where it ends."""
        return self._phase_at(time_s).position_at(time_s)

    def speed_at(self, time_s: float) -> float:
        """Steps/s at a time; zero outside the move."""
        if not self.start_s <= time_s < self.end_s:
            return 0.0
        return self._phase_at(time_s).speed_at(time_s)

    def braked(self, time_s: float, deceleration: float) -> "Motion":
        """The same move with the brakes on from a time; `deceleration` in steps/s², infinite for at once."""
        if time_s >= self.end_s:
            return self
        kept = [phase for phase in self.phases if phase.start_s < time_s]
        speed, position = self.speed_at(time_s), self.position_at(time_s)
        if kept:
            last = kept.pop()
            kept.append(
                Phase(last.start_s, last.position, last.speed, last.acceleration, time_s - last.start_s)
            )
        duration = 0.0 if math.isinf(deceleration) else abs(speed) / deceleration
        slowing = 0.0 if duration == 0.0 else -math.copysign(deceleration, speed)
        kept.append(Phase(time_s, position, speed if duration else 0.0, slowing, duration))
        return Motion(tuple(kept))

    def _phase_at(self, time_s: float) -> Phase:
        for phase in self.phases:
            if time_s < phase.end_s:
                return phase
        return self.phases[-1]


def ramped_move(start_s: float, position: float, steps: float, speed: float, acceleration: float) -> Motion:
    """A move from rest to rest: up at `acceleration`, along at `speed`, down again.

    Args:
        start_s: when it begins.
        position: steps at its start.
        steps: to go, signed.
        speed: at most, steps/s, positive.
        acceleration: steps/s², positive; infinite for a move at constant speed.
    """
    way, distance = math.copysign(1.0, steps), abs(steps)
    if distance == 0.0:
        return Motion((Phase(start_s, position, 0.0, 0.0, 0.0),))
    if math.isinf(acceleration):
        return Motion((Phase(start_s, position, way * speed, 0.0, distance / speed),))
    peak = min(speed, math.sqrt(acceleration * distance))
    ramp_s = peak / acceleration
    along_s = max(0.0, (distance - peak * ramp_s) / peak)
    phases, at_s, at = [], start_s, position
    for from_speed, rate, duration in (
        (0.0, acceleration, ramp_s),
        (peak, 0.0, along_s),
        (peak, -acceleration, ramp_s),
    ):
        phase = Phase(at_s, at, way * from_speed, way * rate, duration)
        phases.append(phase)
        at_s, at = phase.end_s, phase.position_at(phase.end_s)
    return Motion(tuple(phases))


def steady_turn(start_s: float, position: float, speed: float) -> Motion:
    """A turn without end at a signed speed, steps/s."""
    return Motion((Phase(start_s, position, speed, 0.0, math.inf),))
