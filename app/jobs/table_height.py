"""The table's height for a calibration that knows the axis only: from a few stops of a scan."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from app.calibration.record import CalibrationRecord
from app.errors import ScannerError
from app.geometry.axis import TurntableAxis
from app.recording.manifest import FrameEntry
from app.recording.reader import Recording
from app.recording.shot import Role
from app.scanning.drift import REFERENCE_KEY
from app.scanning.find_table import find_table
from app.scanning.reconstruct import ReconstructionOptions
from app.scanning.report import ReconstructionReport
from app.scanning.sources import reconstruct_recording, scan_detector

_STOPS = 36
_STAGE = "Looking for the table"

OnProgress: TypeAlias = Callable[[str, int, int | None], None]
"""Told the stage, how much of it is done and, where known, of how much."""


def with_table(
    record: CalibrationRecord, recordings: Sequence[Recording], show: OnProgress
) -> CalibrationRecord:
    """The record with the table's plane, where it is unknown and a recording shows the table.

    Frames of the empty table serve best, those of a scan nearly as well.
    """
    if record.axis is None or not record.lasers or np.isfinite(record.axis.offset_mm):
        return record
    for role in (Role.BACKGROUND, Role.SCAN):
        for recording in recordings:
            few = _some_stops(recording, role)
            height = float("nan") if few is None else _height(record, few, show)
            if np.isfinite(height):
                axis = record.axis
                along = height - float(axis.point_mm @ axis.direction)
                return replace(record, axis=TurntableAxis(axis.point_mm, axis.direction, along))
    return record


def with_reference(
    record: CalibrationRecord, recordings: Sequence[Recording], show: OnProgress
) -> CalibrationRecord:
    """The record with the height at which each laser sees the empty table now, for later scans."""
    if record.axis is None or not record.lasers or not np.isfinite(record.axis.offset_mm):
        return record
    for recording in recordings:
        few = _some_stops(recording, Role.BACKGROUND)
        report = None if few is None else _looked_at(record, few, show)[1]
        if report is not None and report.drift_reference.table_mm:
            kept = {REFERENCE_KEY: report.drift_reference.as_json()}
            return replace(record, extra={**record.extra, **kept})
    return record


def _some_stops(recording: Recording, role: Role) -> Recording | None:
    """A recording of an even choice of stops, as a scan; None where it has none."""
    entries = [entry for entry in recording.select(role) if entry.angle_deg is not None]
    angles = sorted({entry.angle_deg for entry in entries if entry.lasers_on and entry.angle_deg is not None})
    if not angles:
        return None
    places = np.unique(np.linspace(0, len(angles) - 1, min(_STOPS, len(angles))).astype(int))
    chosen = {angles[place] for place in places}
    frames = tuple(
        _as_scan(entry)
        for entry in recording.entries
        if entry.angle_deg in chosen and entry.role in (role, Role.TEXTURE)
    )
    return Recording(recording.folder, recording.manifest.model_copy(update={"frames": frames}))


def _as_scan(entry: FrameEntry) -> FrameEntry:
    return entry.model_copy(update={"role": Role.SCAN if entry.lasers_on else Role.TEXTURE})


def _height(record: CalibrationRecord, recording: Recording, show: OnProgress) -> float:
    return find_table(_looked_at(record, recording, show)[0])


def _looked_at(
    record: CalibrationRecord, recording: Recording, show: OnProgress
) -> tuple[NDArray[np.float32], ReconstructionReport | None]:
    """All points of the table, (N, 3); and what there is to say of them, None where that is nothing."""
    options = ReconstructionOptions(above_mm=float("-inf"), with_colour=False, skips_bad_frames=True)
    points = [np.zeros((0, 3), np.float32)]
    try:
        run = reconstruct_recording(recording, record.rig, scan_detector(), options)
        for number, profile in enumerate(run, start=1):
            points.append(profile.cloud.points)
            show(_STAGE, number, max(number, run.total))
    except ScannerError:
        # The calibration stands without it; what is wrong with these frames, their reconstruction tells.
        return points[0], None
    return np.concatenate(points), run.report()
