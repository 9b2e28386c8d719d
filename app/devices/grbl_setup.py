"""What a Grbl board has to be set to for a turntable, and what its settings say of it."""

from collections.abc import Mapping
from dataclasses import dataclass

from app.errors import DeviceRefused, DeviceUnrecognised

# Grbl's step timer has 16 bits; grblHAL's chips have better ones.
_SLOWEST_STEPS_S = 30.5
_HOLD, _INCHES, _LASER_MODE = 1, 13, 32
_HOLD_FOR_EVER = 255.0
_STEPS, _SPEED, _ACCELERATION = 100, 110, 120
# Three decimals are shown.
_SAME = 0.0006


@dataclass(frozen=True, slots=True)
class GrblAxis:
    """The axis that turns the table, as the board is set.

    Attributes:
        per_deg: steps in a degree.
        fastest_deg_s, acceleration_deg_s2: its limits.
        slowest_deg_s: below it the board's timer cannot count.
        units_per_inch: 25.4 where the board reports in inches, else 1.
    """

    per_deg: float = 1.0
    fastest_deg_s: float = 1.0
    acceleration_deg_s2: float = 1.0
    slowest_deg_s: float = 0.0
    units_per_inch: float = 1.0


@dataclass(frozen=True, slots=True)
class GrblSetup:
    """The settings that a person has asked for; 0 leaves the board's.

    Attributes:
        axis: its number, from 0.
        steps_per_deg: of the table.
        speed_deg_s: of moves; the board's limit is raised to it where that is lower.
        acceleration_deg_s2: of moves.
    """

    axis: int
    steps_per_deg: float
    speed_deg_s: float
    acceleration_deg_s2: float

    def changes(self, device: str, known: Mapping[int, float]) -> dict[int, float]:
        """Settings that have to be others than the board's; to write them wears its EEPROM.

        Raises:
            DeviceUnrecognised: the board does not tell those of the axis.
        """
        if _STEPS + self.axis not in known:
            raise DeviceUnrecognised(device, "does not tell its settings")
        wanted = {_HOLD: _HOLD_FOR_EVER, _LASER_MODE: 0.0}
        for first, value in ((_STEPS, self.steps_per_deg), (_ACCELERATION, self.acceleration_deg_s2)):
            if value > 0.0:
                wanted[first + self.axis] = value
        if 60.0 * self.speed_deg_s > known[_SPEED + self.axis] + _SAME:
            wanted[_SPEED + self.axis] = 60.0 * self.speed_deg_s
        return wanted

    def axis_of(self, device: str, known: Mapping[int, float], *, has_slow_timer: bool) -> GrblAxis:
        """The axis as these settings make it.

        Raises:
            DeviceRefused: nothing turns with them, or not as slowly as was asked.
        """
        per_deg, acceleration = known[_STEPS + self.axis], known[_ACCELERATION + self.axis]
        fastest = known[_SPEED + self.axis] / 60.0
        if min(per_deg, fastest, acceleration) <= 0.0:
            raise DeviceRefused(device, "has a scale, speed or acceleration of zero", "Set $100 to $122.")
        slowest = _SLOWEST_STEPS_S / per_deg if has_slow_timer else 0.0
        if 0.0 < self.speed_deg_s < slowest:
            raise DeviceRefused(
                device,
                f"cannot turn at {self.speed_deg_s:g} degrees per second",
                f"Set `speed_deg_s` to {slowest:.3g} or more.",
            )
        inches = 25.4 if known.get(_INCHES) else 1.0
        return GrblAxis(per_deg, fastest, acceleration, slowest, inches)


def keeps_current(known: Mapping[int, float]) -> bool:
    """Whether the motor holds the table while it stands."""
    return known.get(_HOLD) == _HOLD_FOR_EVER


def is_other(known: Mapping[int, float], number: int, value: float) -> bool:
    """Whether the board has this setting, and another value for it."""
    return number in known and abs(known[number] - value) > _SAME
