"""Calibrations of Horus, the program of the BQ Ciclop: JSON with a group `calibration_settings`.

The point of a pixel p of the picture, as Horus has turned it, is X = Rz(-angle) (R^T x - R^T t) with
x = d / (n . K^-1 p) K^-1 p. So R's third column points up along the axis, and t lies on the axis, at the
height of the table if somebody measured the pattern's distance from it.
"""

import hashlib
from typing import Annotated, Generic, TypeVar

import numpy as np
from pydantic import AfterValidator

from app.calibration.foreign.fields import CameraMatrix, Lens, Normal, Place, Rotation
from app.calibration.foreign.found import ForeignCalibration, camera_of, plane_of
from app.calibration.foreign.picture_turn import PictureTurn
from app.calibration.record_file import Number, PixelCount, Residual
from app.documents import Entry, parse_document
from app.errors import CalibrationFileError

GROUP = "calibration_settings"
_PROGRAM = "Horus"
# With what Horus starts, before anybody calibrates; the second of a much copied later version.
_UNTOUCHED = (
    (1430.0, 0.0, 480.0, 0.0, 1430.0, 620.0, 0.0, 0.0, 1.0),
    (1308.0, 0.0, 548.0, 0.0, 1308.0, 676.0, 0.0, 0.0, 1.0),
)
_Value = TypeVar("_Value")


class _Setting(Entry, Generic[_Value]):
    """Horus wraps every value in an object."""

    value: _Value


def _is_there(numbers: tuple[float, ...]) -> tuple[float, ...]:
    if not numbers:
        raise ValueError("is empty: Horus was never calibrated")
    return numbers


class _Settings(Entry):
    camera_width: _Setting[PixelCount]
    camera_height: _Setting[PixelCount]
    camera_rotate: _Setting[bool]
    camera_hflip: _Setting[bool]
    camera_vflip: _Setting[bool]
    camera_matrix: _Setting[Annotated[CameraMatrix, AfterValidator(_is_there)]]
    distortion_vector: _Setting[Lens]
    use_distortion: _Setting[bool]
    distance_left: _Setting[Number]
    normal_left: _Setting[Normal]
    distance_right: _Setting[Number]
    normal_right: _Setting[Normal]
    rotation_matrix: _Setting[Rotation]
    translation_vector: _Setting[Place]
    pattern_origin_distance: _Setting[Residual] = _Setting(value=0.0)
    laser_triangulation_hash: _Setting[str] = _Setting(value="")
    platform_extrinsics_hash: _Setting[str] = _Setting(value="")


class _HorusFile(Entry):
    calibration_settings: _Settings


def read_horus(data: bytes, where: str) -> ForeignCalibration:
    """The calibration in a file of Horus; `where` names it in messages.

    Raises:
        CalibrationFileError: naming the field.
    """
    found = parse_document(data, _HorusFile, where, CalibrationFileError).calibration_settings
    turn = PictureTurn.flipped(
        is_transposed=found.camera_rotate.value,
        is_hflipped=found.camera_hflip.value,
        is_vflipped=found.camera_vflip.value,
    )
    camera, lens = camera_of(
        found.camera_matrix.value,
        found.distortion_vector.value,
        turn.size((found.camera_width.value, found.camera_height.value)),
        uses_lens=found.use_distortion.value,
    )
    planes = {
        "left": plane_of(found.normal_left.value, found.distance_left.value),
        "right": plane_of(found.normal_right.value, found.distance_right.value),
    }
    has_axis = any(found.rotation_matrix.value) and any(found.translation_vector.value)
    return ForeignCalibration(
        program=_PROGRAM,
        camera=camera,
        lens=lens,
        uses_lens=found.use_distortion.value,
        turn=turn,
        lasers={name: plane for name, plane in planes.items() if plane is not None},
        missing_lasers=tuple(name for name, plane in planes.items() if plane is None),
        rotation=np.array(found.rotation_matrix.value).reshape(3, 3) if has_axis else None,
        translation_mm=np.array(found.translation_vector.value) if has_axis else None,
        knows_table=found.pattern_origin_distance.value > 0.0,
        direction="ccw",
        notes=tuple(_notes(found, has_axis=has_axis)),
    )


def _notes(found: _Settings, *, has_axis: bool) -> list[str]:
    notes = []
    if found.camera_matrix.value in _UNTOUCHED:
        notes.append("The camera is the one that Horus starts with: it was never calibrated.")
    if found.use_distortion.value:
        notes.append(
            "Horus straightens the pictures and then computes with a camera matrix that differs a little "
            "from that of the straightened ones. Here the lens distortion is applied as it should be, so "
            "points may differ from those of Horus; better calibrate again."
        )
    now = _check_sum(found)
    for what, then, matters in (
        ("laser planes were", found.laser_triangulation_hash.value, any(found.normal_left.value)),
        ("axis was", found.platform_extrinsics_hash.value, has_axis),
    ):
        if matters and then and then != now:
            notes.append(
                f"By Horus's check sum the {what} found with another camera matrix than the one in the file."
            )
    return notes


def _check_sum(found: _Settings) -> str:
    """As Horus computes it: MD5 of the numbers of matrix and distortion in the memory of the computer."""
    numbers = (*found.camera_matrix.value, *found.distortion_vector.value)
    return hashlib.md5(np.array(numbers, "<f8").tobytes(), usedforsecurity=False).hexdigest()
