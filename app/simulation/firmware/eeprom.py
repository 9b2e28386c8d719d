"""The EEPROM of an ATmega: what is in it survives, and writing it takes time with the interrupts off."""

_ERASED = 0xFF
# ATmega328P datasheet, table 24-1: erase and write, and either alone.
_BOTH_S, _ONE_S = 3.4e-3, 1.8e-3
# After a settings line the program needs some time until it writes, and the serial port's own register keeps
# two bytes more: five bytes get through, the next ones are lost (recorded from both Grbl and Horus).
SETTLING_S = 4.7e-4


class Eeprom:
    """Byte cells, written as Grbl's firmware does: only bits that differ, one byte after the other.

    Attributes:
        writes: how often something was written; cells bear some 100 000 times.
    """

    def __init__(self) -> None:
        self._cells: dict[int, int] = {}
        self.writes = 0

    def write(self, address: int, data: bytes) -> float:
        """Store bytes; returns for how many seconds the program is deaf meanwhile."""
        taken = 0.0
        self.writes += 1
        for offset, new in enumerate(data, address):
            old = self._cells.get(offset, _ERASED)
            if new != old:
                taken += _BOTH_S if new & ~old and new != _ERASED else _ONE_S
            self._cells[offset] = new
        return taken

    def read(self, address: int, count: int) -> bytes:
        return bytes(self._cells.get(offset, _ERASED) for offset in range(address, address + count))
