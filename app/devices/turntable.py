"""What every controller board does for the bench: turn the table, switch the lasers, be made safe."""

import math
from dataclasses import dataclass
from typing import Protocol

from app.registry import Registry


@dataclass(frozen=True, slots=True)
class TurntableFacts:
    """What a connected board is and can do.

    Attributes:
        firmware: what it says of itself, such as `Horus 0.2`.
        port: where it is connected; empty for one without a port.
        laser_channels: numbers of the laser outputs it has.
        smallest_deg: the smallest turn it makes.
        slowest_deg_s, fastest_deg_s: speeds it can turn at.
        can_turn_steadily: whether it can turn at a speed that is asked for, for a continuous scan.
        tells_position: whether it can be asked where it is while it moves.
        can_stop: whether a move can be stopped.
        turns_by_itself: it turns all the time at its one speed, and cannot be sent anywhere.
        lasers_by_hand: a person switches the lasers, and would rather not do so for every picture.
    """

    firmware: str
    port: str
    laser_channels: tuple[int, ...]
    smallest_deg: float
    slowest_deg_s: float = 0.0
    fastest_deg_s: float = math.inf
    can_turn_steadily: bool = True
    tells_position: bool = False
    can_stop: bool = True
    turns_by_itself: bool = False
    lasers_by_hand: bool = False


@dataclass(frozen=True, slots=True)
class Farewell:
    """What makes a board safe when its program cannot: played by the watchdog, another process.

    Attributes:
        port: to open.
        baud: its rate.
        words: bytes to send, each with the seconds to wait after it. They are sent to a board in any state.
        stop_bits: of the port.
    """

    port: str
    baud: int
    words: tuple[tuple[bytes, float], ...]
    stop_bits: float = 1


@dataclass(frozen=True, slots=True)
class SteadyTurn:
    """A turn at constant speed that has been started.

    Attributes:
        from_deg: where it starts.
        to_deg: where it will end.
        speed_deg_s: what the board really makes of the speed that was asked for, signed.
        started_s: monotonic time at which the table began to turn, as well as the board lets one know.
        steady_after_s: seconds from the start until the speed is constant.
        duration_s: seconds from start to standstill, as computed.
    """

    from_deg: float
    to_deg: float
    speed_deg_s: float
    started_s: float
    steady_after_s: float
    duration_s: float


class Turntable(Protocol):
    """A controller board with its table and lasers.

    Angles are degrees as the table is told, growing in the direction the bench file states; they are counted
    from where the table stood when it was connected, or from `zero`. Every method may raise the errors of
    `app.errors` that begin with `Device`; `DeviceLost` is final until `connect` is called again.
    """

    @property
    def facts(self) -> TurntableFacts:
        """Known once connected."""
        ...

    @property
    def angle_deg(self) -> float:
        """Where the table stands, or stood when it was last known."""
        ...

    @property
    def farewell(self) -> Farewell | None:
        """How another process makes the board safe; None where there is nothing to do."""
        ...

    @property
    def is_connected(self) -> bool: ...

    def connect(self) -> None:
        """Open the port, wait for the board to be ready, lasers off. The angle is what it was before, or 0.

        On a connected board it finds out whether it still answers, and where it stands.

        Raises:
            PositionUnknown: the board was lost while the table moved. It is connected nevertheless; `zero`
                says where the table stands.
        """
        ...

    def disconnect(self) -> None:
        """Make safe where the board can be reached, and let go of the port. Never fails."""
        ...

    def move_to(self, angle_deg: float) -> float:
        """Turn to an absolute angle, the way the number says (no short cut over 360).

        Returns:
            The angle that was reached, once the table stands still: the nearest the board can make.

        Raises:
            MoveStopped: `stop` was called meanwhile.
        """
        ...

    def start_turning(self, angle_deg: float, speed_deg_s: float) -> SteadyTurn:
        """Begin a turn by a signed angle at a constant speed, and return while it goes on.

        Raises:
            DeviceRefused: the board cannot turn at this speed.
        """
        ...

    def finish_turning(self) -> float:
        """Wait until the steady turn has ended; the angle that was reached."""
        ...

    def position_now(self) -> float | None:
        """Where the table is at this moment, while it turns; None where the board cannot tell."""
        ...

    def stop(self) -> float:
        """Stop the table now, from any thread, before a move that another thread waits for has ended.

        Returns:
            Where it stands; that is known afterwards, unless PositionUnknown is raised.
        """
        ...

    def zero(self, angle_deg: float = 0.0) -> None:
        """From now on the place where the table stands is called by this angle."""
        ...

    def set_laser(self, channel: int, is_on: bool) -> None:
        """Switch a laser; it is switched when this returns."""
        ...

    def hold(self, is_holding: bool) -> None:
        """Hold the table with the motor's current, or let it go."""
        ...

    def make_safe(self) -> None:
        """Table stopped, lasers off, motor let go; from any thread, in any state, at once."""
        ...

    def talk(self, line: str) -> str:
        """Send a line as a person typed it, and return what the board answered; for a console."""
        ...


TURNTABLES: Registry[Turntable] = Registry("controller board", "app.devices.turntables")
