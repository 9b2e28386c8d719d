"""Calibrations as they go out; what is unknown is null."""

import math
from datetime import datetime
from typing import Literal

import numpy as np
from pydantic import BaseModel, ValidationError

from app.calibration.compare import Comparison
from app.calibration.foreign.importing import notes_of
from app.calibration.proof import PROOF_KEY, Verdict
from app.calibration.record import CalibrationRecord
from app.calibration.store import KeptCalibration

Level = Literal["green", "amber", "red"]
# Beyond which a difference is no accident any more.
_SIGMAS = 2.0


class ProofFindingOut(BaseModel):
    """One number of a proof; see `ProofFinding`. `name` is for translation, `level` for the colour."""

    name: str
    value_mm: float
    verdict: Verdict
    level: Level = "green"
    words: str
    cause: str = ""
    remedy: str = ""
    good_mm: float | None = None
    fair_mm: float | None = None


class ProofOut(BaseModel):
    """What the proof of a calibration found."""

    verdict: Verdict
    level: Level = "green"
    stops: int
    points: int
    findings: list[ProofFindingOut]


class CalibrationOut(BaseModel):
    """A calibration that is kept.

    Attributes:
        name: of it in the store: its date.
        method: how it was found, or the program it comes from.
        width, height: of the pictures it is for.
        lasers: those whose planes it knows.
        has_axis, has_table: whether it knows what the table turns about, and how high it is.
        expected_error_mm: what it expects at the object.
        level: of its proof.
        is_current: whether it is in use.
        problem: why it cannot be read; empty where it can.
        missing: what a scan needs and it lacks: `lasers`, `axis`.
    """

    name: str
    created: datetime | None = None
    method: str = ""
    width: int = 0
    height: int = 0
    lasers: list[str] = []
    has_axis: bool = False
    has_table: bool = False
    expected_error_mm: float | None = None
    level: Level | None = None
    is_current: bool
    problem: str = ""
    missing: list[str] = []


class LaserOut(BaseModel):
    """A laser's plane: normal . X = distance_mm, in the camera's frame."""

    name: str
    normal: list[float]
    distance_mm: float
    rms_mm: float | None


class CalibrationDetailOut(CalibrationOut):
    """All that is known of a calibration.

    Attributes:
        focal_px: along columns and rows.
        centre_px: of the picture.
        distortion: k1, k2, p1, p2, k3.
        rms_px: how well the board's corners fit.
        planes: of the lasers.
        axis_rms_mm: how well turning things keep to their circles.
        chi: residuals over assumed noise; near one where all is right.
        proof: what it found; null where there was none.
        notes: what it could not know, of one from elsewhere.
        has_report: whether there is a page with drawings.
    """

    focal_px: list[float] = []
    centre_px: list[float] = []
    distortion: list[float] = []
    rms_px: float | None = None
    planes: list[LaserOut] = []
    axis_rms_mm: float | None = None
    chi: float | None = None
    proof: ProofOut | None = None
    notes: list[str] = []
    has_report: bool = False


class CameraChangeOut(BaseModel):
    """See `CameraChange`."""

    focal_px: list[float]
    focal_percent: float
    centre_px: float
    edge_px: float


class PlaneChangeOut(BaseModel):
    """See `PlaneChange`."""

    name: str
    angle_deg: float
    at_axis_mm: float | None


class AxisChangeOut(BaseModel):
    """See `AxisChange`."""

    shift_mm: float
    tilt_deg: float
    table_mm: float | None


class BallChangeOut(BaseModel):
    """See `BallChange`; of one laser."""

    name: str
    moved_mm: float
    bent_mm: float


class ComparisonOut(BaseModel):
    """What the second calibration has changed.

    Attributes:
        bent_mm: by how much a ball of 60 mm changes its shape, RMS.
        expected_mm: how much of that the two calibrations' own uncertainty explains.
        is_explained: whether it does; null where that is unknown.
        only_first, only_second: lasers that the other does not know.
    """

    camera: CameraChangeOut
    lasers: list[PlaneChangeOut]
    axis: AxisChangeOut | None
    ball: list[BallChangeOut]
    bent_mm: float | None
    expected_mm: float | None
    is_explained: bool | None
    only_first: list[str]
    only_second: list[str]


def shown_calibration(kept: KeptCalibration) -> CalibrationOut:
    """One of the store."""
    return CalibrationOut.model_validate(_facts(kept))


def shown_detail(kept: KeptCalibration) -> CalibrationDetailOut:
    """The same, with all that is known of it."""
    facts, record = _facts(kept), kept.record
    if record is None:
        return CalibrationDetailOut.model_validate(facts)
    camera, chi = record.camera, record.extra.get("chi")
    facts |= {
        "focal_px": np.diag(camera.matrix)[:2].tolist(),
        "centre_px": camera.matrix[:2, 2].tolist(),
        "distortion": camera.distortion.tolist(),
        "rms_px": _known(record.rms_px),
        "planes": [
            LaserOut(
                name=name, normal=plane.normal.tolist(), distance_mm=float(plane.distance_mm),
                rms_mm=_known(record.laser_rms_mm.get(name, math.nan)),
            )
            for name, plane in record.lasers.items()
        ],
        "axis_rms_mm": _known(record.axis_rms_mm),
        "chi": _known(chi) if isinstance(chi, float) else None,
        "proof": _proof(record),
        "notes": list(notes_of(record)),
        "has_report": kept.path.with_suffix(".html").is_file(),
    }  # fmt: skip
    return CalibrationDetailOut.model_validate(facts)


def compared(change: Comparison, first_mm: float, second_mm: float) -> ComparisonOut:
    """A comparison.

    Args:
        change: second minus first.
        first_mm, second_mm: the error that each expects of itself.
    """
    expected, bent = math.hypot(first_mm, second_mm), change.bent_mm
    knows = math.isfinite(expected) and math.isfinite(bent)
    camera, axis = change.camera, change.axis
    return ComparisonOut(
        camera=CameraChangeOut(
            focal_px=list(camera.focal_px), focal_percent=camera.focal_percent, centre_px=camera.centre_px,
            edge_px=camera.edge_px,
        ),
        lasers=[
            PlaneChangeOut(name=name, angle_deg=plane.angle_deg, at_axis_mm=_known(plane.at_axis_mm))
            for name, plane in change.lasers.items()
        ],
        axis=None if axis is None else AxisChangeOut(
            shift_mm=axis.shift_mm, tilt_deg=axis.tilt_deg, table_mm=_known(axis.table_mm)
        ),
        ball=[
            BallChangeOut(name=name, moved_mm=ball.moved_mm, bent_mm=ball.bent_mm)
            for name, ball in change.ball.items()
        ],
        bent_mm=_known(bent),
        expected_mm=_known(expected),
        is_explained=bent <= _SIGMAS * expected if knows else None,
        only_first=list(change.only_first),
        only_second=list(change.only_second),
    )  # fmt: skip


def _facts(kept: KeptCalibration) -> dict[str, object]:
    facts: dict[str, object] = {
        "name": kept.name, "is_current": kept.is_current, "problem": kept.problem,
    }  # fmt: skip
    record = kept.record
    if record is None:
        return facts
    proof, axis = _proof(record), record.axis
    missing = (["lasers"] if not record.lasers else []) + (["axis"] if axis is None else [])
    return facts | {
        "created": record.created,
        "method": record.method,
        "width": record.camera.size[0],
        "height": record.camera.size[1],
        "lasers": list(record.lasers),
        "has_axis": axis is not None,
        "has_table": axis is not None and math.isfinite(axis.offset_mm),
        "expected_error_mm": _known(record.expected_error_mm),
        "level": None if proof is None else proof.level,
        "missing": missing,
    }


def _proof(record: CalibrationRecord) -> ProofOut | None:
    """As it is kept; one that somebody else wrote in another form is none."""
    try:
        proof = ProofOut.model_validate(record.extra.get(PROOF_KEY))
    except ValidationError:
        return None
    # Older files keep the verdict alone.
    proof.level = _level(proof.verdict)
    for finding in proof.findings:
        finding.level = _level(finding.verdict)
    return proof


def _level(verdict: Verdict) -> Level:
    levels: dict[Verdict, Level] = {Verdict.GOOD: "green", Verdict.FAIR: "amber", Verdict.BAD: "red"}
    return levels[verdict]


def _known(number: float) -> float | None:
    return number if math.isfinite(number) else None
