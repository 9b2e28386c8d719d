"""The words that differ between Marlin boards: for lasers, and for what a reset forgets."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

from app.errors import DeviceRefused, OptionError

_SWITCHES = {
    "M42": ("M42 P{0} S255", "M42 P{0} S0"),
    "M106": ("M106 P{0} S255", "M107 P{0}"),
    "M700": ("M700 S255", "M700 S0"),
}
_INSTEAD = {
    "M42": 'Marlin 2 has no M42 by default. Connect the lasers to fan outputs and set laser = "M106" and '
    "lasers = [0, 1] in the bench file.",
    "M106": 'Connect the lasers to spare pins and set laser = "M42" and lasers = [11, 6] in the bench file.',
    "M700": 'M700 is for FABtotum printers. Set laser = "M42" or laser = "M106" in the bench file.',
}


@dataclass(frozen=True, slots=True)
class LaserWords:
    """How a board switches its lasers.

    Attributes:
        laser: `M42` for pins, `M106` for fan outputs, `M700` for the one laser of a FABtotum printer.
    """

    laser: str

    def __post_init__(self) -> None:
        if self.laser not in _SWITCHES:
            raise OptionError(
                f"A Marlin board does not switch lasers by {self.laser!r}.",
                f"Choose one of: {', '.join(_SWITCHES)}.",
            )

    def switch(self, channel: int, is_on: bool) -> str:
        return _SWITCHES[self.laser][0 if is_on else 1].format(channel)

    def check(self, device: str, channel: int, answer: Sequence[str]) -> None:
        """Raise DeviceRefused where the board has not done it, with the option to choose instead."""
        told = " ".join(answer).lower()
        if "unknown command" in told:
            raise DeviceRefused(device, f"does not know {self.laser} for its lasers", _INSTEAD[self.laser])
        if "protected" in told:
            raise DeviceRefused(
                device,
                f"does not let {self.laser} switch pin {channel}",
                "Connect the laser to a free pin and put its number into the option `lasers`.",
            )


def setup_words(axis: str, acceleration: float, fastest: float, laser: str) -> list[str]:
    """What makes an axis a turntable: no limits, no end switches, motor held, absolute units."""
    words = []
    if axis == "E":
        # FABtotum's firmware is older than P.
        words = ["M302 S0" if laser == "M700" else "M302 P1", "M82"]
    words += ["G21", "G90", "M121", "M211 S0", "M84 S0"]
    # E alone moves with the acceleration of a retraction.
    rate = f"{acceleration:g}"
    return [*words, f"M203 {axis}{fastest:g}", f"M201 {axis}{rate}", f"M204 P{rate} R{rate} T{rate}"]


def steps_per_unit(settings: Sequence[str], axis: str) -> float:
    """From the answer to M503; NaN where it does not say."""
    found = re.search(rf"M92\b[^\n]*\b{axis}\s*([\d.]+)", "\n".join(settings))
    return float(found[1]) if found else math.nan
