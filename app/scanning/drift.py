"""Has the scanner changed since it was calibrated? What a scan shows of that, against what it should show."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from app.scanning.agreement import LaserAgreement
from app.scanning.table import TableCheck

# From how much on it is worth watching, and is too much. Measured on the simulated bench, on healthy scans
# and with lasers and cameras moved by 0.1 to 0.3 degrees.
_APART_MM = (0.15, 0.3)
_SURFACE_MM = (0.15, 0.3)
_HEIGHT_MM = (0.4, 1.0)
_MARKERS_PX = (1.0, 1.5)
# A laser is the one that moved where the others see the table so much better.
_CLEARLY = 1.0 / 3.0

REFERENCE_KEY = "drift"
"""Where a calibration file keeps what later scans are compared with."""


class DriftLevel(StrEnum):
    """How much has changed."""

    OK = "ok"
    WATCH = "watch"
    DRIFTED = "drifted"


@dataclass(frozen=True, slots=True)
class DriftFinding:
    """One thing that a scan shows of it.

    Attributes:
        name: `table-apart` (lasers see the table at different heights), `table-height`, `lasers-apart` (on
            the object) or `markers`.
        level: how much has changed.
        value: how far off it is, in `unit`.
        unit: `mm` or `px`.
        watch, drifted: from where on it is worth watching, and too much.
        cause: for translation: `laser-moved`, `camera-moved`, `camera-or-table-moved`,
            `laser-or-axis-moved`; empty where all is well.
        laser: that has moved, where that is known.
        words: one sentence; empty where all is well.
        remedy: what to do; empty where all is well.
    """

    name: str
    level: DriftLevel
    value: float
    unit: str
    watch: float
    drifted: float
    cause: str = ""
    laser: str = ""
    words: str = ""
    remedy: str = ""


@dataclass(frozen=True, slots=True)
class Drift:
    """All findings, worst first.

    Attributes:
        findings: empty where the scan could not tell anything.
    """

    findings: tuple[DriftFinding, ...] = ()

    @property
    def level(self) -> DriftLevel:
        """The worst."""
        return self.findings[0].level if self.findings else DriftLevel.OK

    @property
    def sentences(self) -> tuple[str, ...]:
        """What to tell a person, of what is worst; empty where all is well."""
        worst = [f for f in self.findings if f.level is self.level and f.words]
        return tuple(f"{f.words} {f.remedy}" for f in worst[:1])

    def as_json(self) -> dict[str, Any]:
        """For programs."""
        return {
            "level": self.level.value,
            "findings": [
                {
                    "name": f.name, "level": f.level.value, "value": f.value, "unit": f.unit,
                    "watch": f.watch, "drifted": f.drifted, "cause": f.cause, "laser": f.laser,
                    "words": f.words, "remedy": f.remedy,
                }
                for f in self.findings
            ],
        }  # fmt: skip


@dataclass(frozen=True, slots=True)
class DriftReference:
    """What the same looked like right after the calibration.

    Attributes:
        table_mm: height at which each laser saw the table, by name.
    """

    table_mm: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def kept_in(cls, extra: Mapping[str, Any]) -> "DriftReference | None":
        """Among the further keys of a calibration file; None where it keeps none that can be read."""
        kept = extra.get(REFERENCE_KEY)
        table = kept.get("table_mm") if isinstance(kept, dict) else None
        if not isinstance(table, dict):
            return None
        return cls({laser: float(mm) for laser, mm in table.items() if isinstance(mm, int | float)})

    def as_json(self) -> dict[str, Any]:
        """What a calibration file keeps of it."""
        return {"table_mm": dict(self.table_mm)}


def find_drift(
    tables: Mapping[str, TableCheck],
    agreements: Sequence[LaserAgreement],
    marker_rms_px: float,
    reference: DriftReference | None = None,
) -> Drift:
    """What a scan shows of it.

    Args:
        tables: the table as each laser saw it, by name, of those that saw it well.
        agreements: of every pair of lasers.
        marker_rms_px: by how much markers on the table are elsewhere; NaN where there are none.
        reference: what was there when the scanner was calibrated.
    """
    known = {} if reference is None else reference.table_mm
    heights = {laser: seen.offset_mm - known.get(laser, 0.0) for laser, seen in tables.items()}
    findings = [*_apart(heights), *_height(heights), *_surfaces(agreements), *_markers(marker_rms_px)]
    order = list(DriftLevel)
    return Drift(tuple(sorted(findings, key=lambda f: order.index(f.level), reverse=True)))


def _apart(heights: Mapping[str, float]) -> list[DriftFinding]:
    if len(heights) < 2:
        return []
    low, high = min(heights, key=heights.__getitem__), max(heights, key=heights.__getitem__)
    apart = heights[high] - heights[low]
    odd = max(heights, key=lambda laser: abs(heights[laser]))
    others = [abs(height) for laser, height in heights.items() if laser != odd]
    is_one = max(others) < _CLEARLY * abs(heights[odd])
    seen = f"Laser {low!r} sees the table {apart:.2f} mm lower than laser {high!r} does"
    if is_one:
        words = f"{seen}: laser {odd!r} has moved since the calibration."
        return [_finding("table-apart", apart, _APART_MM, "laser-moved", odd, words, _fix(f"laser {odd!r}"))]
    words = f"{seen}, and both are wrong: the camera has been turned since the calibration."
    return [_finding("table-apart", apart, _APART_MM, "camera-moved", "", words, _fix("the camera"))]


def _height(heights: Mapping[str, float]) -> list[DriftFinding]:
    """All lasers see it at one height, which is not that of the calibration."""
    if not heights:
        return []
    low, high = min(heights.values()), max(heights.values())
    # As far as all of them agree about it.
    common = 0.0 if low * high <= 0.0 else min(abs(low), abs(high))
    side = "higher" if low > 0.0 else "lower"
    words = (
        f"The table is seen {common:.2f} mm {side} than at the calibration: camera or table were moved, or "
        "something flat lies on it."
    )
    return [
        _finding("table-height", common, _HEIGHT_MM, "camera-or-table-moved", "", words,
                 "Take away what lies on the table; if nothing does, calibrate again.")
    ]  # fmt: skip


def _surfaces(agreements: Sequence[LaserAgreement]) -> list[DriftFinding]:
    if not agreements:
        return []
    worst = max(agreements, key=lambda pair: pair.disagreement_mm)
    words = (
        f"Lasers {worst.first!r} and {worst.second!r} measure the object {worst.disagreement_mm:.2f} mm "
        "apart: one of them, the camera or the table has moved since the calibration, or the object moved."
    )
    return [
        _finding("lasers-apart", worst.disagreement_mm, _SURFACE_MM, "laser-or-axis-moved", "", words,
                 "Scan something solid once more; if it says so again, calibrate again.")
    ]  # fmt: skip


def _markers(rms_px: float) -> list[DriftFinding]:
    if not rms_px >= 0.0:
        return []
    words = (
        f"The markers on the table are {rms_px:.1f} px from where they should be: the camera or the table "
        "was moved since the calibration."
    )
    return [
        _finding("markers", rms_px, _MARKERS_PX, "camera-or-table-moved", "", words,
                 _fix("camera and table"), "px")
    ]  # fmt: skip


def _fix(what: str) -> str:
    return f"Fix {what} in place and calibrate again."


def _finding(
    name: str, value: float, limits: tuple[float, float], cause: str, laser: str, words: str, remedy: str,
    unit: str = "mm",
) -> DriftFinding:  # fmt: skip
    watch, drifted = limits
    if value < watch:
        return DriftFinding(name, DriftLevel.OK, value, unit, watch, drifted)
    level = DriftLevel.WATCH if value < drifted else DriftLevel.DRIFTED
    return DriftFinding(name, level, value, unit, watch, drifted, cause, laser, words, remedy)
