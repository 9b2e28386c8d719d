"""How the Horus firmware turns its motor, and what it counts and prints of that."""

import math

import numpy as np

from app.simulation.firmware.horus_settings import HorusSettings
from app.simulation.firmware.motion import Motion, Phase, ramped_move
from app.simulation.firmware.plant import Plant

# A 16-bit timer with a clock of 2 MHz counts no longer step than 32.8 ms.
_SLOWEST_STEPS_S = 30.5
_STEPS_PER_DEG, _FASTEST, _ACCELERATION = 100, 110, 120


class HorusMotor:
    """One move at a time.

    Attributes:
        position: steps as counted when the last move ended.
        motion: the move under way.
        is_braking: whether it is being held.
    """

    def __init__(self, plant: Plant, settings: HorusSettings) -> None:
        self._plant, self._settings = plant, settings
        self.position = 0
        self.motion: Motion | None = None
        self.is_braking = False

    def steps(self, angle_deg: float) -> int:
        return round(angle_deg * self._settings[_STEPS_PER_DEG])

    def start(self, target: int, feed: float, now_s: float) -> Motion:
        """A move to a place, steps, at a speed in degrees per second."""
        per_degree = self._settings[_STEPS_PER_DEG]
        speed = max(min(feed, self._settings[_FASTEST]) * per_degree, _SLOWEST_STEPS_S)
        acceleration = self._settings[_ACCELERATION] * per_degree
        steps = target - self.position
        self.motion = ramped_move(now_s, self.position, steps, speed, acceleration)
        self._plant.move(self.motion)
        return self.motion

    def end(self) -> None:
        """The move under way is over."""
        if self.motion is not None:
            self.position = round(self.motion.position_at(math.inf))
        self.motion = None

    def brake(self, now_s: float) -> None:
        """Slow down to a whole step, with about the acceleration that is set."""
        motion = self.motion
        assert motion is not None
        speed, at = motion.speed_at(now_s), motion.position_at(now_s)
        way = math.copysign(1.0, motion.steps)
        deceleration = self._settings[_ACCELERATION] * self._settings[_STEPS_PER_DEG]
        stop = math.ceil(way * at + speed * speed / (2.0 * deceleration))
        if stop >= way * motion.position_at(math.inf):
            return
        distance = stop - way * at
        # Below the slowest speed there is no ramp left: the step that has begun is the last.
        if distance > 0.0 and abs(speed) > _SLOWEST_STEPS_S:
            self.motion = motion.braked(now_s, speed * speed / (2.0 * distance))
        else:
            self.motion = _ended(motion, now_s, way * stop)
        self._plant.replan(self.motion)
        self.is_braking = True

    def break_off(self, now_s: float) -> None:
        """The pulses stop where they are.

        The interrupt counts a step when it prepares it, so the count is one ahead of the pulses.
        """
        motion = self.motion
        assert motion is not None
        way = math.copysign(1.0, motion.steps)
        done = way * math.floor(way * motion.position_at(now_s) + 1e-9)
        self._plant.replan(_ended(motion, now_s, done))
        self.position, self.motion = int(done + way), None

    def printed(self, now_s: float) -> str:
        """Where it counts itself, degrees, as the status report has it."""
        return _printed(np.float32(self._counted(now_s)) / np.float32(self._settings[_STEPS_PER_DEG]))

    def _counted(self, now_s: float) -> int:
        if self.motion is None:
            return self.position
        if now_s >= self.motion.end_s:
            return round(self.motion.position_at(math.inf))
        way = math.copysign(1.0, self.motion.steps)
        return int(way * (math.floor(way * self.motion.position_at(now_s)) + 1))


def _printed(number: np.float32) -> str:
    """Three decimals by the firmware's own way in single precision, which shows in the last one."""
    thousandths = int(
        np.float32(np.float32(abs(number) * np.float32(100)) * np.float32(10)) + np.float32(0.5)
    )
    sign = "-" if number < 0 else ""
    return f"{sign}{thousandths // 1000}.{thousandths % 1000:03d}"


def _ended(motion: Motion, time_s: float, position: float) -> Motion:
    """The same move, standing at a position from a time on."""
    kept = [phase for phase in motion.braked(time_s, math.inf).phases if phase.start_s < time_s]
    return Motion((*kept, Phase(time_s, position, 0.0, 0.0, 0.0)))
