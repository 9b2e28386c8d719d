"""Calibrations of FabScanPi: the group `calibration` of its configuration, JSON.

The same formulas as those of Horus, from which they come, but the cloud is turned by plus the angle. Truth
values are text, in quotes, and numpy's brackets may be doubled.
"""

import numpy as np
from pydantic import Field

from app.calibration.foreign.fields import CameraMatrix, Lens, Normal, Place, Rotation, Truth
from app.calibration.foreign.found import ForeignCalibration, camera_of, plane_of
from app.calibration.foreign.picture_turn import PictureTurn
from app.calibration.record_file import Number, PixelCount, Residual
from app.documents import Entry, parse_document
from app.errors import CalibrationFileError
from app.geometry.plane import LaserPlane

GROUP = "calibration"
_PROGRAM = "FabScanPi"
# Laser 0 of its server is the right one, 1 the left one.
_NAMES = ("right", "left")
_SIZE_NOTE = (
    "FabScanPi does not keep the size of the pictures that it calibrated with: camera.resolution is taken."
)
_AGE_NOTE = (
    "FabScanPi saves its configuration also when a calibration has failed: these numbers may be older than "
    "the file."
)


class _Pattern(Entry):
    origin_distance: Residual = 0.0


class _Plane(Entry):
    distance: Number | None = None
    normal: Normal = ()
    deviation: Residual | None = None


class _Calibration(Entry):
    pattern: _Pattern = _Pattern()
    camera_matrix: CameraMatrix
    distortion_vector: Lens
    laser_planes: list[_Plane] = Field(max_length=16)
    platform_rotation: Rotation
    platform_translation: Place


class _Resolution(Entry):
    width: PixelCount
    height: PixelCount


class _Camera(Entry):
    resolution: _Resolution
    rotate: Truth
    hflip: Truth
    vflip: Truth
    undistort: Truth = False


class _Laser(Entry):
    numbers: int | None = None


class _FabScanFile(Entry):
    calibration: _Calibration
    camera: _Camera
    laser: _Laser = _Laser()


def read_fabscan(data: bytes, where: str) -> ForeignCalibration:
    """The calibration in a configuration of FabScanPi; `where` names the file in messages.

    Raises:
        CalibrationFileError: naming the field.
    """
    file = parse_document(data, _FabScanFile, where, CalibrationFileError)
    found = file.calibration
    if not found.camera_matrix:
        raise CalibrationFileError(
            f"{where}: calibration.camera_matrix", "is empty: FabScanPi was never calibrated"
        )
    turn = PictureTurn.flipped(
        is_transposed=file.camera.rotate, is_hflipped=file.camera.hflip, is_vflipped=file.camera.vflip
    )
    resolution = file.camera.resolution
    camera, lens = camera_of(
        found.camera_matrix,
        found.distortion_vector,
        turn.size((resolution.width, resolution.height)),
        uses_lens=file.camera.undistort,
    )
    planes = _planes(file)
    has_axis = any(found.platform_rotation) and any(found.platform_translation)
    return ForeignCalibration(
        program=_PROGRAM,
        camera=camera,
        lens=lens,
        uses_lens=file.camera.undistort,
        turn=turn,
        lasers={name: plane for name, (plane, _) in planes.items() if plane is not None},
        laser_rms_mm={
            name: rms for name, (plane, rms) in planes.items() if plane is not None and rms is not None
        },
        missing_lasers=tuple(name for name, (plane, _) in planes.items() if plane is None),
        rotation=np.array(found.platform_rotation).reshape(3, 3) if has_axis else None,
        translation_mm=np.array(found.platform_translation) if has_axis else None,
        knows_table=found.pattern.origin_distance > 0.0,
        direction="cw",
        notes=(_SIZE_NOTE, _AGE_NOTE),
    )


def _planes(file: _FabScanFile) -> dict[str, tuple[LaserPlane | None, float | None]]:
    """Plane and residual of each laser that the scanner has, by name."""
    planes = file.calibration.laser_planes
    count = len(planes) if file.laser.numbers is None else max(file.laser.numbers, 1)
    return {
        _NAMES[number] if number < len(_NAMES) else f"laser {number}": (
            plane_of(plane.normal, plane.distance or 0.0),
            plane.deviation,
        )
        for number, plane in enumerate(planes[:count])
    }
