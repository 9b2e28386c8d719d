"""Bench files of the simulated bench, with two red lasers."""

from collections.abc import Mapping

_DEVICES = """
[turntable]
driver = "simulated"
{turntable}[camera]
driver = "simulated"
[[lasers]]
name = "left"
channel = 1
colour = "red"
[[lasers]]
name = "right"
channel = {right}
colour = "red"
"""
_PLATTER = """[platter]
kind = "aruco"
dictionary = "DICT_4X4_50"
marker_mm = {marker_mm}
ids = {ids}
"""


def simulated_bench(
    simulation: Mapping[str, str | float],
    *,
    name: str = "",
    turntable: str = "settle_s = 0.0\n",
    right: int = 2,
    marker_mm: float | None = None,
    markers: int = 6,
) -> str:
    """The text of a bench file.

    Args:
        simulation: keys of the simulated bench, see `WorldPlan`.
        name: of the bench; empty for none.
        turntable: further lines of its table; without others, it need not settle.
        right: channel of the right laser.
        marker_mm: side of the markers on the table, in mm; None for a table without.
        markers: how many there are.
    """
    head = f'name = "{name}"\n' if name else ""
    text = head + _DEVICES.format(turntable=turntable, right=right)
    if marker_mm is not None:
        text += _PLATTER.format(marker_mm=marker_mm, ids=list(range(markers)))
    return text + "[simulation]\n" + "".join(f"{key} = {_toml(value)}\n" for key, value in simulation.items())


def _toml(value: str | float) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else repr(value)
