"""The bytes of the first FabScan's firmware, and how one hears that it has done them: a ping behind them."""

import contextlib
import re

from app.devices.laser_care import dark_unless_answered
from app.devices.serial_link import SerialLink
from app.errors import DeviceTimeout, DeviceUnrecognised

BAUD, STOP_BITS = 9600, 2
LASER_OFF, LASER_ON, STEP, CLOCKWISE, COUNTER_CLOCKWISE = b"\xc8", b"\xc9", b"\xca", b"\xcb", b"\xcc"
MOTOR_ON, MOTOR_OFF, PING, ENDLESS = b"\xcd", b"\xce", b"\xd2", b"\xd1"
# Ends a command that was broken off before its second byte, and means nothing by itself.
NOTHING = b"\x00"
PONG = re.compile(rb"\xd3")
# Shorter than the boot loader, so that the 211 after a reset is not taken for the answer to a ping.
PONG_S = 0.6
_SELECT = b"\xd4"
# The table's number in the shield's firmware, and in the first one, which does not answer when it is chosen.
_TABLE, _FIRST_TABLE = b"\x0a", b"\x00"
_BOOT_S, _REBOOT_S = 2.5, 1.5
_FIRST_PONG_S, _SELECTED_S = 1.0, 0.3


class BoardRestarted(Exception):  # noqa: N818 (an event, not an error)
    """The board has reset itself instead of answering: its laser is on, its motor off."""


class FabScan100Line:
    """Bytes out and pings back, over a link that its owner opens and closes.

    Attributes:
        link: the port.
        is_lit, is_powered: how laser and motor shall be, also after a reset of the board.
    """

    def __init__(self, link: SerialLink) -> None:
        self.link = link
        self.is_lit = self.is_powered = False

    def greet(self, *, is_new: bool) -> None:
        """Make sure who it is, without sending anything to a board that has said something else; choose the
        table's motor.

        Args:
            is_new: the port was just opened, which resets the board, or does not.

        Raises:
            DeviceUnrecognised: it is not this board.
        """
        heard = self.link.listen(_BOOT_S, PONG) if is_new else b""
        if heard and not PONG.search(heard):
            raise DeviceUnrecognised(
                self.link.device, f"{self.link.port} is no FabScan100; it sends {heard[:20]!r}"
            )
        if heard:
            self.link.write(LASER_OFF)
        self.link.discard()
        for _ in range(2):
            self.link.write(NOTHING + PING)
            with contextlib.suppress(DeviceTimeout):
                self.link.wait_for(PONG, _FIRST_PONG_S, "ping")
                self.link.write(LASER_OFF)
                self._select_table()
                return
        raise DeviceUnrecognised(self.link.device, f"{self.link.port} does not answer as a FabScan100")

    def restore(self) -> None:
        """Laser and motor as they were asked for."""
        laser = LASER_ON if self.is_lit else LASER_OFF
        self.link.write(laser + (MOTOR_ON if self.is_powered else MOTOR_OFF))

    def command(self, data: bytes, timeout_s: float = PONG_S, words_off: bytes = b"") -> None:
        """Send something and wait until it is done; a board that has just reset itself is told once more.

        Args:
            words_off: sent where no answer comes, before anything else is waited for.
        """
        with contextlib.suppress(BoardRestarted):
            self.link.write(data + PING)
            self.await_pong(timeout_s, words_off)
            return
        self.link.write(data + PING)
        self.await_pong(timeout_s, words_off)

    def await_pong(self, timeout_s: float, words_off: bytes = b"") -> None:
        """Until the board has done what was sent. Raises BoardRestarted, when it is restored."""
        try:
            with dark_unless_answered(self.link, words_off):
                self.link.wait_for(PONG, timeout_s, "ping")
        except DeviceTimeout:
            if not PONG.search(self.link.listen(_REBOOT_S, PONG)):
                raise
            self.restore()
            raise BoardRestarted from None

    def heed(self) -> None:
        """A 211 that nobody asked for: the board has reset itself, and its laser is on."""
        if PONG.search(self.link.discard()):
            self.restore()

    def _select_table(self) -> None:
        self.link.write(_SELECT + _TABLE)
        try:
            self.link.wait_for(re.compile(_TABLE), _SELECTED_S, "select the table")
        except DeviceTimeout:
            self.link.write(_SELECT + _FIRST_TABLE)
