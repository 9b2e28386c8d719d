"""How long a move takes that speeds up, goes along and slows down."""

import math

from app.devices.turntable import SteadyTurn


def ramped_s(angle_deg: float, speed_deg_s: float, acceleration_deg_s2: float) -> float:
    """Seconds from rest to rest, at one acceleration."""
    distance = abs(angle_deg)
    if distance < speed_deg_s**2 / acceleration_deg_s2:
        return 2.0 * math.sqrt(distance / acceleration_deg_s2)
    return distance / speed_deg_s + speed_deg_s / acceleration_deg_s2


def longest_deg(duration_s: float, speed_deg_s: float, acceleration_deg_s2: float) -> float:
    """The angle that takes so long; the inverse of `ramped_s`."""
    ramp_s = speed_deg_s / acceleration_deg_s2
    if duration_s < 2.0 * ramp_s:
        return acceleration_deg_s2 * (0.5 * duration_s) ** 2
    return (duration_s - ramp_s) * speed_deg_s


def ramped_turn(
    from_deg: float, to_deg: float, speed_deg_s: float, acceleration_deg_s2: float, started_s: float
) -> SteadyTurn:
    """A steady turn at a positive speed, with a ramp at either end."""
    return SteadyTurn(
        from_deg,
        to_deg,
        math.copysign(speed_deg_s, to_deg - from_deg),
        started_s,
        steady_after_s=speed_deg_s / acceleration_deg_s2,
        duration_s=ramped_s(to_deg - from_deg, speed_deg_s, acceleration_deg_s2),
    )
