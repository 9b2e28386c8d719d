"""What the drivers of boards on a serial port do alike: keep the port and the angle, and let go of both."""

import contextlib

from app.devices.bearings import Bearings
from app.devices.serial_link import SerialLink
from app.errors import DeviceError


class BoardDriver:
    """Half of a `Turntable`: a driver adds how its board is met, turned, lit and made safe.

    Attributes:
        port: where the board is connected.
        name: what messages call it.
    """

    def __init__(self, link: SerialLink, bearings: Bearings) -> None:
        self.port, self.name = link.port, link.device
        self._link, self._bearings = link, bearings

    @property
    def angle_deg(self) -> float:
        return self._bearings.angle_deg

    @property
    def is_connected(self) -> bool:
        return self._link.is_open

    def disconnect(self) -> None:
        if self._link.is_open:
            with contextlib.suppress(DeviceError):
                self.make_safe()
        self._release()

    def zero(self, angle_deg: float = 0.0) -> None:
        self._bearings.tell(angle_deg)

    def position_now(self) -> float | None:
        """Most boards cannot be asked while they turn."""
        return None

    def make_safe(self) -> None:
        raise NotImplementedError

    def _release(self) -> None:
        """Let go of the port, and of threads that use it."""
        self._link.close()
