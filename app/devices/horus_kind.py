"""What a board that says it is a Horus can do: the true firmware, and its clone with whole degrees."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from app.devices.ramp import longest_deg, ramped_s

# The step timer of the firmware has 16 bits and counts 2 MHz.
_SLOWEST_STEPS_S = 30.5
# From the end of the ramp until `ok`: idle delay, and the loop that notices.
_AFTER_S = 0.05
_SETTING = re.compile(r"\$(\d+)=([\d.]+)")
# 16 bits, four steps for each position.
_CLONE_LIMIT_DEG = 5700.0
# The clone cannot be stopped, so that its moves are made in pieces; one takes about 1.5 s.
_CLONE_PIECE_DEG = 20.0
_CLONE_SPEED, _CLONE_ACCELERATION = 500.0 / 4.0, 200.0 / 4.0


class HorusKind(Protocol):
    """How a board turns.

    Attributes:
        firmware: what it is.
        is_clone: whether it cannot be asked anything, held or told a speed.
        smallest_deg: the largest gap between neighbouring places where it can stand.
        slowest_deg_s, fastest_deg_s: its speeds.
        brake_s: how long it slows down from full speed.
        piece_deg: no move is longer; infinite where moves can be stopped.
        limit_deg: it cannot count further to either side.
        laser_channels: all it has.
    """

    @property
    def firmware(self) -> str: ...
    @property
    def is_clone(self) -> bool: ...
    @property
    def smallest_deg(self) -> float: ...
    @property
    def slowest_deg_s(self) -> float: ...
    @property
    def fastest_deg_s(self) -> float: ...
    @property
    def brake_s(self) -> float: ...
    @property
    def piece_deg(self) -> float: ...
    @property
    def limit_deg(self) -> float: ...
    @property
    def laser_channels(self) -> tuple[int, ...]: ...

    def reached(self, x_deg: float) -> float:
        """The place nearest to an angle where it can stand."""
        ...

    def line(self, reached_deg: float, speed_deg_s: float) -> str:
        """The command that brings it to such a place."""
        ...

    def seconds(self, angle_deg: float, speed_deg_s: float) -> float:
        """How long a move takes, the answer included."""
        ...

    def longest_deg(self, duration_s: float, speed_deg_s: float) -> float:
        """The longest move that is over within a time."""
        ...


@dataclass(frozen=True, slots=True)
class TrueHorus:
    """Horus 0.1 and 0.2, as its settings describe it.

    Attributes:
        steps_per_deg: `$100`.
        fastest_deg_s: `$110`.
        acceleration_deg_s2: `$120`.
    """

    firmware: str = "Horus 0.2"
    steps_per_deg: float = 3200.0 / 360.0
    fastest_deg_s: float = 180.0
    acceleration_deg_s2: float = 180.0
    is_clone: bool = False
    piece_deg: float = math.inf
    limit_deg: float = math.inf
    laser_channels: tuple[int, ...] = (1, 2, 3, 4)

    @property
    def smallest_deg(self) -> float:
        return 1.0 / self.steps_per_deg

    @property
    def slowest_deg_s(self) -> float:
        return _SLOWEST_STEPS_S / self.steps_per_deg

    @property
    def brake_s(self) -> float:
        return self.fastest_deg_s / self.acceleration_deg_s2

    def reached(self, x_deg: float) -> float:
        return round(x_deg * self.steps_per_deg) / self.steps_per_deg

    def line(self, reached_deg: float, speed_deg_s: float) -> str:
        # F goes with every move: each reset forgets it.
        return f"G1F{speed_deg_s:.3f}X{reached_deg:.4f}"

    def seconds(self, angle_deg: float, speed_deg_s: float) -> float:
        return ramped_s(angle_deg, self._speed(speed_deg_s), self.acceleration_deg_s2) + _AFTER_S

    def longest_deg(self, duration_s: float, speed_deg_s: float) -> float:
        left_s = max(0.0, duration_s - _AFTER_S)
        return longest_deg(left_s, self._speed(speed_deg_s), self.acceleration_deg_s2)

    def _speed(self, speed_deg_s: float) -> float:
        return min(max(speed_deg_s, self.slowest_deg_s), self.fastest_deg_s)


@dataclass(frozen=True, slots=True)
class CloneHorus:
    """The clone: places by `atoi` of degrees, rounded towards zero, at its own speed."""

    positions_per_turn: int = 512
    firmware: str = "Horus clone (whole degrees)"
    is_clone: bool = True
    piece_deg: float = _CLONE_PIECE_DEG
    limit_deg: float = _CLONE_LIMIT_DEG
    laser_channels: tuple[int, ...] = (1, 2)
    brake_s: float = 0.0

    @property
    def smallest_deg(self) -> float:
        return math.ceil(self.positions_per_turn / 360.0) * 360.0 / self.positions_per_turn

    @property
    def slowest_deg_s(self) -> float:
        return self.fastest_deg_s

    @property
    def fastest_deg_s(self) -> float:
        return _CLONE_SPEED * 360.0 / self.positions_per_turn

    def reached(self, x_deg: float) -> float:
        return min(
            (self._place(degrees) for degrees in self._near(x_deg)), key=lambda place: abs(place - x_deg)
        )

    def line(self, reached_deg: float, speed_deg_s: float) -> str:
        degrees = min(
            self._near(reached_deg), key=lambda candidate: abs(self._place(candidate) - reached_deg)
        )
        return f"G1X{degrees}"

    def seconds(self, angle_deg: float, speed_deg_s: float) -> float:
        acceleration = _CLONE_ACCELERATION * 360.0 / self.positions_per_turn
        return ramped_s(angle_deg, self.fastest_deg_s, acceleration) + _AFTER_S

    def longest_deg(self, duration_s: float, speed_deg_s: float) -> float:
        acceleration = _CLONE_ACCELERATION * 360.0 / self.positions_per_turn
        return longest_deg(duration_s, self.fastest_deg_s, acceleration)

    def _place(self, degrees: int) -> float:
        return int(degrees * self.positions_per_turn / 360) * 360.0 / self.positions_per_turn

    def _near(self, x_deg: float) -> range:
        return range(math.floor(x_deg) - 2, math.ceil(x_deg) + 3)


def read_settings(listing: str) -> Mapping[int, float]:
    """Numbers and values of what `$$` prints."""
    return {int(number): float(value) for number, value in _SETTING.findall(listing)}


def true_horus(firmware: str, settings: Mapping[int, float]) -> TrueHorus:
    """The board that a listing describes.

    `$100` is printed with three decimals; a whole number of steps in a turn that fits is the true one.
    """
    usual = TrueHorus()
    per_degree = settings.get(100) or usual.steps_per_deg
    per_turn = round(360.0 * per_degree)
    if abs(360.0 * per_degree - per_turn) <= 0.19:
        per_degree = per_turn / 360.0
    return TrueHorus(
        firmware,
        per_degree,
        settings.get(110) or usual.fastest_deg_s,
        settings.get(120) or usual.acceleration_deg_s2,
    )
