"""The calibration file, version 1, entry by entry."""

import math
from datetime import datetime
from typing import Annotated, Literal

from pydantic import Field, field_validator

from app.documents import Entry, Json

_LARGEST = 10**9
# Numbers copied by hand from a paper have six digits or so.
_UNIT_TOLERANCE = 1e-3

Number = Annotated[float, Field(ge=-_LARGEST, le=_LARGEST)]
Residual = Annotated[float, Field(ge=0.0, le=_LARGEST)]
PixelCount = Annotated[int, Field(gt=0, le=65535)]
Triple = tuple[Number, Number, Number]


class CameraEntry(Entry):
    width: PixelCount
    height: PixelCount
    matrix: tuple[Triple, Triple, Triple]
    distortion: tuple[Number, Number, Number, Number, Number]
    rms_px: Residual | None = None

    @field_validator("matrix")
    @classmethod
    def _is_a_camera_matrix(cls, matrix: tuple[Triple, Triple, Triple]) -> tuple[Triple, Triple, Triple]:
        check_camera_matrix(matrix)
        return matrix


class LaserEntry(Entry):
    normal: Triple
    distance_mm: Number
    rms_mm: Residual | None = None

    @field_validator("normal")
    @classmethod
    def _points_away(cls, normal: Triple) -> Triple:
        check_unit(normal)
        if normal[2] < 0.0:
            raise ValueError("must have positive z: change the signs of normal and distance_mm together")
        return normal

    @field_validator("distance_mm")
    @classmethod
    def _misses_the_camera(cls, distance_mm: float) -> float:
        if distance_mm == 0.0:
            raise ValueError("is 0: a laser plane through the camera's centre measures nothing")
        return distance_mm


class AxisEntry(Entry):
    point_mm: Triple
    direction: Triple
    rms_mm: Residual | None = None

    @field_validator("direction")
    @classmethod
    def _is_unit(cls, direction: Triple) -> Triple:
        check_unit(direction)
        return direction


class TableEntry(Entry):
    offset_mm: Number | None = None


class CalibrationFile(Entry):
    """A whole calibration file; one of a camera alone has neither lasers nor axis."""

    format: Literal["turnscan-calibration"]
    version: Literal[1]
    created: str
    camera: CameraEntry
    lasers: dict[Annotated[str, Field(min_length=1, max_length=200)], LaserEntry] = Field(
        default_factory=dict
    )
    axis: AxisEntry | None = None
    table: TableEntry | None = None
    method: str | None = None
    expected_error_mm: Residual | None = None

    @field_validator("created")
    @classmethod
    def _is_a_moment(cls, created: str) -> str:
        try:
            moment = datetime.fromisoformat(created)
        except ValueError:
            moment = None
        if moment is None or moment.tzinfo is None or not 1900 < moment.year < 9999:
            raise ValueError(f"must be a time such as 2026-11-21T10:00:00Z, not {created[:40]!a}")
        return created

    def all_unknown(self) -> Json:
        """Unknown keys of every level, nested as in the file."""
        lasers = {name: laser.unknown for name, laser in self.lasers.items() if laser.unknown}
        nested = {
            "camera": self.camera.unknown,
            "lasers": lasers,
            "axis": self.axis.unknown if self.axis else {},
            "table": self.table.unknown if self.table else {},
        }
        return self.unknown | {name: keys for name, keys in nested.items() if keys}


def check_camera_matrix(matrix: tuple[Triple, Triple, Triple]) -> None:
    """Raise ValueError unless it is a pinhole's matrix without skew."""
    (fx, skew, _), (zero, fy, _), last = matrix
    if not (fx > 0.0 and fy > 0.0):
        raise ValueError(f"focal lengths must be greater than 0, not {fx:g} and {fy:g}")
    if skew != 0.0 or zero != 0.0 or last != (0.0, 0.0, 1.0):
        raise ValueError("must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]")


def check_unit(vector: Triple) -> None:
    """Raise ValueError unless the vector's length is one, as nearly as people write it."""
    length = math.hypot(*vector)
    if abs(length - 1.0) > _UNIT_TOLERANCE:
        raise ValueError(f"must be a unit vector, but its length is {length:g}")
