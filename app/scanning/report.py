"""What a reconstruction has to say about itself."""

from dataclasses import dataclass

from app.scanning.agreement import LaserAgreement
from app.scanning.angles import AngleSummary
from app.scanning.drift import Drift, DriftReference
from app.scanning.table import TableCheck


@dataclass(frozen=True, slots=True)
class SkippedFrame:
    """A frame that gave no points, and why."""

    name: str
    reason: str


@dataclass(frozen=True, eq=False, slots=True)
class ReconstructionReport:
    """The outcome of one run.

    Attributes:
        points: how many points there are.
        profiles: how many profiles they came in.
        outside: points that were left out because they lie outside the region.
        skipped: frames that gave nothing.
        angles: where the angles came from.
        agreements: every pair of lasers that saw the same surface.
        tables: the table as points and markers show it; empty where neither could tell.
        drift: what the scan shows of a scanner that has changed since its calibration.
        drift_reference: how the table looks in this scan, for later ones.
        warnings: sentences for the person, most important first.
        doubts: why the result must not be trusted; empty where it can.
    """

    points: int
    profiles: int
    outside: int
    skipped: tuple[SkippedFrame, ...]
    angles: AngleSummary
    agreements: tuple[LaserAgreement, ...]
    tables: tuple[TableCheck, ...]
    drift: Drift
    drift_reference: DriftReference
    warnings: tuple[str, ...]
    doubts: tuple[str, ...]
