"""A camera from a file: a calibration of this program, or the YAML or XML that OpenCV's programs write."""

from pathlib import Path

import cv2
import numpy as np

from app.calibration.record import CalibrationRecord
from app.errors import CalibrationFileError
from app.files import reason
from app.geometry.arrays import Floats
from app.geometry.camera import CameraIntrinsics

OPENCV_SUFFIXES = frozenset({".yml", ".yaml", ".xml"})
_MOST_BYTES = 2**20
# Names that the calibration sample of OpenCV gives them, and those that are common elsewhere.
_MATRIX = ("camera_matrix", "cameraMatrix", "K")
_DISTORTION = ("distortion_coefficients", "dist_coeffs", "distCoeffs", "D")
_OPENCV_HINT = "It needs image_width, image_height, camera_matrix and distortion_coefficients."


def load_camera(path: Path | str) -> CameraIntrinsics:
    """The camera of a calibration file.

    Raises:
        CalibrationFileError: naming the file and the field.
    """
    path = Path(path)
    if path.suffix.lower() in OPENCV_SUFFIXES:
        return _load_opencv(path)
    return CalibrationRecord.load(path).camera


def _load_opencv(path: Path) -> CameraIntrinsics:
    try:
        with path.open("rb") as file:
            return parse_opencv(file.read(_MOST_BYTES + 1), str(path))
    except OSError as error:
        raise CalibrationFileError(str(path), reason(error)) from error


def parse_opencv(data: bytes, source: str) -> CameraIntrinsics:
    """The camera of a YAML or XML file of OpenCV; `source` names it in messages.

    Raises:
        CalibrationFileError: naming the source and the field.
    """
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise CalibrationFileError(source, "is not UTF-8 text") from error
    if len(text) > _MOST_BYTES or "\0" in text:
        raise CalibrationFileError(source, "is not a camera of OpenCV", _OPENCV_HINT)
    try:
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        size = tuple(int(storage.getNode(name).real()) for name in ("image_width", "image_height"))
        matrix, distortion = _numbers(storage, _MATRIX), _numbers(storage, _DISTORTION)
        storage.release()
    except (cv2.error, SystemError, ValueError, OverflowError) as error:
        raise CalibrationFileError(source, "is not a camera of OpenCV", _OPENCV_HINT) from error
    for name, is_there in (
        ("image_width and image_height", min(size) > 0),
        (_MATRIX[0], matrix.size == 9),
        (_DISTORTION[0], distortion.size >= 4),
    ):
        if not is_there:
            raise CalibrationFileError(f"{source}: {name}", "is missing or of another size", _OPENCV_HINT)
    if np.any(distortion[5:]):
        raise CalibrationFileError(
            f"{source}: {_DISTORTION[0]}",
            "has terms beyond k1, k2, p1, p2, k3, which this program does not know",
        )
    five = np.zeros(5)
    five[: min(5, distortion.size)] = distortion[:5]
    record = CalibrationRecord(camera=CameraIntrinsics(matrix.reshape(3, 3), five, (size[0], size[1])))
    try:
        return CalibrationRecord.parse(record.to_bytes(), source).camera
    except CalibrationFileError as error:
        raise CalibrationFileError(source, error.problem, _OPENCV_HINT) from error


def _numbers(storage: cv2.FileStorage, names: tuple[str, ...]) -> Floats:
    """The first matrix of these names, flat; empty where there is none."""
    for name in names:
        matrix = storage.getNode(name).mat()
        if matrix is not None:
            return np.asarray(matrix, np.float64).ravel()
    return np.zeros(0)
