"""A calibration as it is kept: the rig, its residuals, when and with what it was found.

This is the calibration file, version 1, of the recording format. Numbers are written so that they are read
back to the last bit; keys that this program does not know are kept at every level.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from app.calibration.record_file import AxisEntry, CalibrationFile, CameraEntry, LaserEntry
from app.documents import Json, parse_document, read_document
from app.errors import CalibrationFileError
from app.files import write_whole
from app.geometry.arrays import Vector3
from app.geometry.axis import TurntableAxis
from app.geometry.camera import CameraIntrinsics
from app.geometry.plane import LaserPlane
from app.geometry.rig import Rig

_NAN = float("nan")


def _now() -> datetime:
    return datetime.now(UTC).replace(microsecond=0)


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class CalibrationRecord:
    """What a calibration found. A camera alone is one too: lasers empty, axis None.

    Attributes:
        camera: the camera.
        lasers: planes by name.
        axis: what the table turns about, its `offset_mm` NaN where the table is unknown.
        rms_px: reprojection residual of the camera; NaN where unknown, as the other residuals.
        laser_rms_mm: residual of each plane by name, where known.
        axis_rms_mm: residual of the axis.
        method: how it was found, such as joint or paper; empty where unknown.
        expected_error_mm: what the covariance predicts at the object.
        created: when, in UTC.
        extra: further keys; a nested object whose name is known (`camera`, `lasers`, `axis`, `table`)
            adds to that object and never replaces what is known.
        source: the file it came from, for messages.
    """

    camera: CameraIntrinsics
    lasers: Mapping[str, LaserPlane] = field(default_factory=dict)
    axis: TurntableAxis | None = None
    rms_px: float = _NAN
    laser_rms_mm: Mapping[str, float] = field(default_factory=dict)
    axis_rms_mm: float = _NAN
    method: str = ""
    expected_error_mm: float = _NAN
    created: datetime = field(default_factory=_now)
    extra: Mapping[str, Any] = field(default_factory=dict)
    source: str = "the calibration"

    @classmethod
    def load(cls, path: Path | str) -> "CalibrationRecord":
        """Read a calibration file.

        Raises:
            CalibrationFileError: naming the file and the field.
        """
        return _from_file(read_document(Path(path), CalibrationFile, CalibrationFileError), str(path))

    @classmethod
    def parse(cls, data: bytes, source: str) -> "CalibrationRecord":
        """The bytes of a calibration file; `source` names them in messages.

        Raises:
            CalibrationFileError: naming the source and the field.
        """
        return _from_file(parse_document(data, CalibrationFile, source, CalibrationFileError), source)

    def save(self, path: Path | str) -> None:
        """Write the file whole, or not at all.

        Raises:
            OutputError: it cannot be written.
            CalibrationFileError: it holds values that no reader would take.
        """
        data = self.to_bytes()
        parse_document(data, CalibrationFile, str(path), CalibrationFileError)
        write_whole(Path(path), data)

    def to_bytes(self) -> bytes:
        """The file."""
        document = _merged(self.extra, self._as_json())
        try:
            return (json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode()
        except (TypeError, ValueError) as error:
            raise CalibrationFileError(self.source, f"cannot be written: {error}") from error

    @property
    def rig(self) -> Rig:
        """The calibrated scanner.

        Raises:
            CalibrationFileError: the lasers or the axis are missing.
        """
        if not self.lasers:
            raise CalibrationFileError(self.source, "holds no laser plane")
        if self.axis is None:
            raise CalibrationFileError(self.source, "holds no axis")
        return Rig(self.camera, self.lasers, self.axis)

    def _as_json(self) -> Json:
        width, height = self.camera.size
        camera = {
            "width": int(width), "height": int(height), "matrix": self.camera.matrix.tolist(),
            "distortion": self.camera.distortion.tolist(), **_known(rms_px=self.rms_px),
        }  # fmt: skip
        lasers = {
            name: {
                "normal": plane.normal.tolist(), "distance_mm": float(plane.distance_mm),
                **_known(rms_mm=self.laser_rms_mm.get(name, _NAN)),
            }
            for name, plane in self.lasers.items()
        }  # fmt: skip
        document: Json = {
            "format": "turnscan-calibration", "version": 1,
            "created": self.created.astimezone(UTC).isoformat().replace("+00:00", "Z"),
            "camera": camera, "lasers": lasers,
        }  # fmt: skip
        if self.axis is not None:
            document["axis"] = {
                "point_mm": self.axis.point_mm.tolist(), "direction": self.axis.direction.tolist(),
                **_known(rms_mm=self.axis_rms_mm),
            }  # fmt: skip
            if math.isfinite(self.axis.offset_mm):
                document["table"] = {"offset_mm": float(self.axis.offset_mm)}
        if self.method:
            document["method"] = self.method
        return document | _known(expected_error_mm=self.expected_error_mm)


def _from_file(file: CalibrationFile, source: str) -> CalibrationRecord:
    offset = _NAN if file.table is None or file.table.offset_mm is None else file.table.offset_mm
    return CalibrationRecord(
        camera=_camera(file.camera),
        lasers={name: _plane(laser) for name, laser in file.lasers.items()},
        axis=None if file.axis is None else _axis(file.axis, offset),
        rms_px=_or_nan(file.camera.rms_px),
        laser_rms_mm={n: laser.rms_mm for n, laser in file.lasers.items() if laser.rms_mm is not None},
        axis_rms_mm=_NAN if file.axis is None else _or_nan(file.axis.rms_mm),
        method=file.method or "",
        expected_error_mm=_or_nan(file.expected_error_mm),
        created=datetime.fromisoformat(file.created).astimezone(UTC),
        extra=file.all_unknown(),
        source=source,
    )


def _camera(entry: CameraEntry) -> CameraIntrinsics:
    return CameraIntrinsics(
        np.array(entry.matrix, np.float64),
        np.array(entry.distortion, np.float64),
        (entry.width, entry.height),
    )


def _plane(entry: LaserEntry) -> LaserPlane:
    normal, length = _unit(entry.normal)
    return LaserPlane(normal, entry.distance_mm / length)


def _axis(entry: AxisEntry, offset_mm: float) -> TurntableAxis:
    direction, _ = _unit(entry.direction)
    return TurntableAxis(np.array(entry.point_mm, np.float64), direction, offset_mm)


def _unit(numbers: tuple[float, float, float]) -> tuple[Vector3, float]:
    """Unit vector and the length that was divided by; what is a unit vector already is not touched."""
    vector = np.array(numbers, np.float64)
    length = float(np.linalg.norm(vector))
    if abs(length - 1.0) < 1e-12:
        return vector, 1.0
    return vector / length, length


def _or_nan(number: float | None) -> float:
    return _NAN if number is None else number


def _known(**numbers: float) -> dict[str, float]:
    """Those that are not NaN."""
    return {name: float(number) for name, number in numbers.items() if not math.isnan(number)}


def _merged(extra: Mapping[str, Any], known: Mapping[str, Any]) -> Json:
    """Both, level by level; known first, and where they differ known wins."""
    merged: Json = dict(known)
    for name, value in extra.items():
        here = merged.get(name)
        if name not in merged:
            merged[name] = value
        elif isinstance(here, dict) and isinstance(value, Mapping):
            merged[name] = _merged(value, here)
    return merged
