"""The `$` settings of the Horus firmware, and how they lie in its EEPROM."""

import struct
from dataclasses import dataclass

from app.simulation.firmware.eeprom import Eeprom

_VERSION = 9
_COORDINATES_AT, _COORDINATES = 512, 8
_STEPS_PER_DEG = 16 / 1.8


@dataclass(frozen=True, slots=True)
class _Setting:
    """One line of the listing.

    Attributes:
        form: how it is stored and shown: `float`, `byte`, `mask`, or `bit` of the flags.
        scale: stored value over shown value.
    """

    default: float
    label: str
    form: str = "float"
    scale: float = 1.0
    bit: int = 0


# The recording leaves out most labels; these give the listing its recorded length, 870 bytes.
_SETTINGS = {
    0: _Setting(10, "step pulse, usec", "byte"),
    1: _Setting(25, "step idle delay, msec", "byte"),
    2: _Setting(0, "step port invert mask:", "mask"),
    3: _Setting(6, "dir port invert mask:", "mask"),
    4: _Setting(0, "step enable invert, bool", "bit", bit=2),
    5: _Setting(0, "limit pins invert, bool", "bit", bit=6),
    6: _Setting(0, "probe pin invert, bool", "bit", bit=7),
    10: _Setting(3, "status report mask:", "mask"),
    11: _Setting(0.02, "junction deviation, mm"),
    12: _Setting(0.002, "arc tolerance, mm"),
    13: _Setting(0, "report inches, bool", "bit", bit=0),
    20: _Setting(0, "soft limits, bool", "bit", bit=5),
    21: _Setting(0, "hard limits, bool", "bit", bit=3),
    22: _Setting(0, "homing cycle, bool", "bit", bit=4),
    23: _Setting(0, "homing dir invert mask:", "mask"),
    **{100 + n: _Setting(_STEPS_PER_DEG, f"{axis}, step/deg") for n, axis in enumerate("xyz")},
    **{110 + n: _Setting(180, f"{axis} max rate, deg/s", scale=60) for n, axis in enumerate("xyz")},
    **{120 + n: _Setting(180, f"{axis} accel, deg/s^2", scale=3600) for n, axis in enumerate("xyz")},
    **{130 + n: _Setting(1080, f"{axis} max travel, deg", scale=-1) for n, axis in enumerate("xyz")},
}
_FLAGS = [number for number, setting in _SETTINGS.items() if setting.form == "bit"]


class HorusSettings:
    """Values by their number; they survive a reset.

    Args:
        is_blank: as on a board that was never started with this firmware.

    Attributes:
        eeprom: where they are kept.
    """

    def __init__(self, *, is_blank: bool = False) -> None:
        self._values = {number: float(setting.default) for number, setting in _SETTINGS.items()}
        self.eeprom = Eeprom()
        if not is_blank:
            self.restore()

    def __getitem__(self, number: int) -> float:
        return self._values[number]

    @property
    def is_blank(self) -> bool:
        return self.eeprom.read(0, 1) != bytes([_VERSION])

    def restore(self) -> float:
        """Write all of it for the first time; the seconds that takes."""
        taken = self.eeprom.write(0, bytes([_VERSION]) + self._packed())
        return taken + self.eeprom.write(_COORDINATES_AT, bytes(13 * _COORDINATES))

    def store(self, number: int, value: float) -> float | str:
        """Change one setting; the seconds its writing takes, or the words of an error."""
        if value < 0.0:
            return "Value < 0"
        if number not in _SETTINGS or number == 21:
            return "Invalid statement"
        if number == 0 and value < 3:
            return "Value < 3 usec"
        if number == 20 and value and not self._values[22]:
            return "Homing not enabled"
        form = _SETTINGS[number].form
        if form == "bit":
            value = float(bool(int(value)))
        elif form != "float":
            value = float(int(value) & 0xFF)
        self._values[number] = value
        return self.eeprom.write(1, self._packed())

    def listing(self) -> str:
        """What `$$` prints."""
        lines = []
        for number, setting in _SETTINGS.items():
            value = self._values[number]
            shown = f"{value:.3f}" if setting.form == "float" else str(int(value))
            mask = f"{int(value):08b}" if setting.form == "mask" else ""
            lines.append(f"${number}={shown} ({setting.label}{mask})\r\n")
        return "".join(lines)

    def _packed(self) -> bytes:
        data = b""
        for number, setting in _SETTINGS.items():
            value = self._values[number]
            if setting.form == "float":
                data += struct.pack("<f", value * setting.scale)
            elif setting.form != "bit":
                data += bytes([int(value)])
        flags = sum(int(self._values[number]) << _SETTINGS[number].bit for number in _FLAGS)
        return data + bytes([flags])
