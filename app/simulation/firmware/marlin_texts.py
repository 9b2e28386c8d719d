"""What Marlin says of itself: at its start, of its settings, and when it is asked who it is."""

from collections.abc import Sequence

_OLD_START = """start
echo:PowerUp
Marlin {version}

echo: Last Updated: 2017-05-12 12:00 | Author: (MoebyusMachines, default config)
Compiled: Jun  5 2017
echo: Free Memory: 3341  PlannerBufferBytes: 1232
echo:Hardcoded Default Settings Loaded
"""
_NEW_START = """start
Marlin {version}
echo: Last Updated: 2021-11-15 | Author: (none, default config)
echo:Compiled: Nov 20 2021
echo: Free Memory: 4287  PlannerBufferBytes: 1200
echo:Hardcoded Default Settings Loaded
"""
_SETTINGS = """echo:  G21    ; Units in mm
echo:  M149 C ; Units in Celsius

echo:Filament settings: Disabled
echo:  M200 D3.00
echo:  M200 D0
echo:Steps per unit:
echo:  M92 X{x:.2f} Y80.20 Z4000.00 E{e:.2f}
echo:Maximum feedrates (units/s):
echo:  M203 X{fast_x:.2f} Y400.00 Z2.00 E{fast_e:.2f}
echo:Maximum Acceleration (units/s2):
echo:  M201 X{rate:.0f} Y3000 Z100 E{rate:.0f}
echo:Acceleration (units/s2): P<print_accel> R<retract_accel> T<travel_accel>
echo:  M204 P{rate:.2f} R{rate:.2f} T{rate:.2f}
echo:Advanced: S<min_feedrate> T<min_travel_feedrate> B<min_segment_time_ms> X<max_xy_jerk> Z<max_z_jerk> E<max_e_jerk>
echo:  M205 S0.00 T0.00 B20000 X10.00 Z0.40 E5.00
echo:Home offset:
echo:  M206 X0.00 Y0.00 Z0.00
echo:PID settings:
echo:  M301 P22.20 I1.08 D114.00
"""  # noqa: E501 (as the board says it)
_WHO = (
    "FIRMWARE_NAME:Marlin {version} (Github) SOURCE_CODE_URL:https://github.com/MarlinFirmware/Marlin "
    "PROTOCOL_VERSION:1.0 MACHINE_TYPE:{machine} EXTRUDER_COUNT:1 "
    "UUID:cede2a2f-41a2-4748-9b12-c55c62f367ff\n"
)
_CAPABILITIES = (
    "SERIAL_XON_XOFF:0",
    "EEPROM:0",
    "AUTOREPORT_TEMP:1",
    "EMERGENCY_PARSER:0",
    "PROMPT_SUPPORT:0",
)


def settings(per_mm: Sequence[float], fastest: Sequence[float], acceleration: float) -> str:
    """The answer to M503; X first, then E."""
    return _SETTINGS.format(x=per_mm[0], e=per_mm[1], fast_x=fastest[0], fast_e=fastest[1], rate=acceleration)


def start(version: str, *, is_old: bool) -> str:
    """What comes before the settings when the board starts."""
    return (_OLD_START if is_old else _NEW_START).format(version=version)


def who(version: str, *, is_old: bool) -> str:
    """The answer to M115; version 2 ends its capabilities in CR LF and all else in LF."""
    name = _WHO.format(version=version, machine="PrusaI3MM" if is_old else "3D Printer")
    return name if is_old else name + "".join(f"Cap:{word}\r\n" for word in _CAPABILITIES)
