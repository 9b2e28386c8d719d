"""A calibration in the form that OpenCV's programs read: camera, and beside it lasers and axis."""

import math

import cv2

from app.calibration.camera_file import OPENCV_SUFFIXES
from app.calibration.record import CalibrationRecord
from app.errors import OptionError

_COMMENT = (
    "Camera frame: x right, y down, z out of the lens, millimetres. "
    "A laser's plane: normal . X = distance_mm. Axis: direction points up from the table."
)


def as_opencv(record: CalibrationRecord, ending: str = ".yml") -> bytes:
    """The file. The names of the camera's entries are those of OpenCV's calibration sample.

    Args:
        record: the calibration.
        ending: .yml or .yaml for YAML, .xml for XML.

    Raises:
        OptionError: it is another ending.
    """
    if ending not in OPENCV_SUFFIXES:
        raise OptionError(f"{ending!r} is no file of OpenCV.", "Name a .yml, .yaml or .xml file.")
    out = cv2.FileStorage(ending, cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    out.writeComment(_COMMENT)
    out.write("calibration_time", f"{record.created:%Y-%m-%dT%H:%M:%SZ}")
    out.write("image_width", int(record.camera.size[0]))
    out.write("image_height", int(record.camera.size[1]))
    out.write("camera_matrix", record.camera.matrix)
    out.write("distortion_coefficients", record.camera.distortion[:, None])
    _write_known(out, "avg_reprojection_error", record.rms_px)
    _write_known(out, "expected_error_mm", record.expected_error_mm)
    out.startWriteStruct("lasers", cv2.FILE_NODE_SEQ)
    for name, plane in record.lasers.items():
        out.startWriteStruct("", cv2.FILE_NODE_MAP)
        out.write("name", name)
        out.write("normal", plane.normal[:, None])
        out.write("distance_mm", float(plane.distance_mm))
        _write_known(out, "rms_mm", record.laser_rms_mm.get(name, math.nan))
        out.endWriteStruct()
    out.endWriteStruct()
    if record.axis is not None:
        out.startWriteStruct("axis", cv2.FILE_NODE_MAP)
        out.write("point_mm", record.axis.point_mm[:, None])
        out.write("direction", record.axis.direction[:, None])
        _write_known(out, "rms_mm", record.axis_rms_mm)
        _write_known(out, "table_offset_mm", record.axis.offset_mm)
        out.endWriteStruct()
    return out.releaseAndGetString().encode()


def _write_known(out: cv2.FileStorage, name: str, value: float) -> None:
    if math.isfinite(value):
        out.write(name, float(value))
