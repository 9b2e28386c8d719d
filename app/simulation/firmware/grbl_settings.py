"""Grbl's `$` settings as they lie in its EEPROM, and what writing them costs."""

import struct
from dataclasses import dataclass, field

_ERASE_AND_WRITE_S, _ONE_OF_BOTH_S = 0.0034, 0.0018
_BUSY_S = 0.0004
_WHOLE, _SWITCH, _REAL = "whole", "switch", "real"

_DEFAULTS: dict[int, tuple[str, float]] = {
    0: (_WHOLE, 10), 1: (_WHOLE, 25), 2: (_WHOLE, 0), 3: (_WHOLE, 0), 4: (_SWITCH, 0), 5: (_SWITCH, 0),
    6: (_SWITCH, 0), 10: (_WHOLE, 1), 11: (_REAL, 0.010), 12: (_REAL, 0.002), 13: (_SWITCH, 0),
    20: (_SWITCH, 0), 21: (_SWITCH, 0), 22: (_SWITCH, 0), 23: (_WHOLE, 0), 24: (_REAL, 25.0),
    25: (_REAL, 500.0), 26: (_WHOLE, 250), 27: (_REAL, 1.0), 30: (_WHOLE, 1000), 31: (_WHOLE, 0),
    32: (_SWITCH, 0),
}  # fmt: skip
_AXIS_DEFAULTS = {100: 250.0, 110: 500.0, 120: 10.0, 130: 200.0}
# Accelerations are kept in units/min².
_KEPT_SCALE = {120: 3600.0}


class SettingError(Exception):
    """The error number that Grbl answers."""

    def __init__(self, number: int) -> None:
        super().__init__(f"error:{number}")
        self.number = number


@dataclass(slots=True)
class GrblSettings:
    """The numbers behind `$`.

    Attributes:
        axes: how many axes the board has.
        is_blank: the EEPROM has never been written.
        writes: how often a cell was, which is what wears it.
    """

    axes: int = 3
    is_blank: bool = False
    writes: int = 0
    _values: dict[int, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._values = {number: value for number, (_, value) in _DEFAULTS.items()}
        for first, value in _AXIS_DEFAULTS.items():
            self._values |= {first + axis: value for axis in range(self.axes)}

    def __getitem__(self, number: int) -> float:
        return self._values[number]

    def listing(self) -> str:
        return "".join(f"${number}={self._written(number)}\r\n" for number in self._values)

    def write(self, number: int, value: float) -> float:
        """Keep a value; how long interrupts are off for it, seconds.

        Raises:
            SettingError: no such setting, or no such value.
        """
        if value < 0.0:
            raise SettingError(4)
        if number not in self._values:
            raise SettingError(3)
        if number == 0 and value < 3.0:
            raise SettingError(6)
        if number == 20 and value and not self._values[22]:
            raise SettingError(10)
        kind = self._kind(number)
        if kind == _WHOLE:
            value = float(int(value) if number >= 30 else int(value) & 0xFF)
        elif kind == _SWITCH:
            value = float(value != 0.0)
        before = self._cells(number)
        self._values[number] = value
        changes = [
            _cell_s(old, new) for old, new in zip(before, self._cells(number), strict=True) if old != new
        ]
        self.writes += bool(changes)
        return _BUSY_S + sum(changes)

    def _kind(self, number: int) -> str:
        return _DEFAULTS[number][0] if number in _DEFAULTS else _REAL

    def _written(self, number: int) -> str:
        value = self._values[number]
        return f"{value:.3f}" if self._kind(number) == _REAL else str(int(value))

    def _cells(self, number: int) -> bytes:
        value, kind = self._values[number], self._kind(number)
        if kind == _SWITCH:
            # One bit among others of its byte.
            return bytes([8 if value else 0])
        if kind == _WHOLE and number < 30:
            return bytes([int(value)])
        return struct.pack("<f", value * _KEPT_SCALE.get(number // 10 * 10, 1.0))


def _cell_s(old: int, new: int) -> float:
    """A cell that only loses bits is not erased, and one that becomes 0xFF is not written."""
    return _ERASE_AND_WRITE_S if (old ^ new) & new and new != 0xFF else _ONE_OF_BOTH_S
