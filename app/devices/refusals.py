"""What boards are not asked, and the sentences that say why not."""

import math
from collections.abc import Callable, Sequence

from app.errors import DeviceLost, DeviceRefused

# Computed speeds do not fail by their rounding.
_SLACK = 1e-4


def check_laser(device: str, channel: int, channels: Sequence[int], hint: str = "") -> None:
    """Raise DeviceRefused for a laser that a board does not have.

    Args:
        device: what messages call the board.
        channel: the laser.
        channels: those it has.
        hint: where there is more to say than their numbers.
    """
    if channel not in channels:
        known = ", ".join(map(str, channels)) or "none"
        raise DeviceRefused(device, f"has no laser {channel}", hint or f"Its lasers are: {known}.")


def check_speed(device: str, speed_deg_s: float, slowest_deg_s: float, fastest_deg_s: float) -> None:
    """Raise DeviceRefused for a speed, of either sign, that a board cannot turn at."""
    speed = abs(speed_deg_s)
    if speed > 0.0 and (1.0 - _SLACK) * slowest_deg_s <= speed <= (1.0 + _SLACK) * fastest_deg_s:
        return
    high = f"{_rounded(fastest_deg_s, math.floor):g}" if math.isfinite(fastest_deg_s) else "any"
    low = f"from {_rounded(slowest_deg_s, math.ceil):g} to" if slowest_deg_s > 0.0 else "above 0 and up to"
    raise DeviceRefused(
        device,
        f"cannot turn at {speed_deg_s:g} degrees per second",
        f"Choose a speed {low} {high} degrees per second.",
    )


def resets_again(device: str) -> DeviceLost:
    """The board does not stay up long enough for a command."""
    return DeviceLost(device, "resets itself again and again", "Check its power supply.")


def _rounded(value: float, inwards: Callable[[float], int]) -> float:
    """Four digits, so that the number that is told may be chosen."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 3)
    return inwards(round(value / unit, 6)) * unit
