"""Two scans side by side."""

from typing import Any

import anyio
from fastapi import APIRouter
from pydantic import BaseModel

from app.api.scan_models import ScanOut, shown_scan
from app.api.services import Served
from app.library.compare import compare_scans
from app.library.deviation import Distances

router = APIRouter(prefix="/scans", tags=["scans"])
# Each takes a second or two of a core, and memory: the others wait.
_ONE_AT_A_TIME = anyio.CapacityLimiter(1)


class DifferenceOut(BaseModel):
    """A setting that is not the same; null where a scan does not have it."""

    setting: str
    first: Any
    second: Any


class DistancesOut(BaseModel):
    """From points of one cloud to the nearest of the other; see `Distances`."""

    asked: int
    median_mm: float
    rms_mm: float
    p95_mm: float


class DeviationOut(BaseModel):
    """Two clouds against each other; see `Deviation`."""

    there: DistancesOut
    back: DistancesOut
    spacing_mm: float


class ComparisonOut(BaseModel):
    """Two scans; see `ScanComparison`. `calibration` is as `turnscan calibrations compare --json` has it."""

    first: ScanOut
    second: ScanOut
    settings: list[DifferenceOut]
    calibration: dict[str, Any] | None
    calibration_note: str
    deviation: DeviationOut | None
    deviation_note: str


@router.get("/{first}/compare/{second}")
async def compare(served: Served, first: str, second: str) -> ComparisonOut:
    """What differs in settings, points and calibration, and how far the newest clouds lie apart."""
    found = await anyio.to_thread.run_sync(
        compare_scans, served.library, first, second, limiter=_ONE_AT_A_TIME
    )
    apart = found.deviation
    return ComparisonOut(
        first=shown_scan(found.first), second=shown_scan(found.second),
        settings=[
            DifferenceOut(setting=each.setting, first=each.first, second=each.second)
            for each in found.settings
        ],
        calibration=None if found.calibration is None else found.calibration.as_json(),
        calibration_note=found.calibration_note,
        deviation=None if apart is None else DeviationOut(
            there=_shown(apart.there), back=_shown(apart.back), spacing_mm=apart.spacing_mm
        ),
        deviation_note=found.deviation_note,
    )  # fmt: skip


def _shown(distances: Distances) -> DistancesOut:
    return DistancesOut(
        asked=distances.asked, median_mm=distances.median_mm, rms_mm=distances.rms_mm,
        p95_mm=distances.p95_mm,
    )  # fmt: skip
