"""The first Horus firmware: another banner, and no G50."""

from app.simulation.firmware.dialects.horus import Horus
from app.simulation.firmware.horus_words import commands_without
from app.simulation.firmware.kernel import FIRMWARES


class HorusFirst(Horus):
    """Horus 0.1."""

    version = "0.1"
    commands = commands_without("G50")


FIRMWARES.register("horus_0_1", HorusFirst)
