"""Time in the simulated world, which may run faster than ours."""

import time
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Clock:
    """World seconds against this machine's monotonic clock.

    Attributes:
        rate: world seconds in one of ours.
        started_s: monotonic time at world time 0.
    """

    rate: float = 1.0
    started_s: float = field(default_factory=time.monotonic)

    def now_s(self) -> float:
        """World time."""
        return self.world_s(time.monotonic())

    def world_s(self, monotonic_s: float) -> float:
        return (monotonic_s - self.started_s) * self.rate

    def monotonic_s(self, world_s: float) -> float:
        return self.started_s + world_s / self.rate

    def wait_s(self, world_s: float) -> float:
        """How long from now until a world time, in our seconds; never negative."""
        return max(0.0, self.monotonic_s(world_s) - time.monotonic())
