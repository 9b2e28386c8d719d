"""Cameras that other programs calibrated."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from app.calibration.camera_file import load_camera
from app.calibration.record import CalibrationRecord
from app.errors import CalibrationFileError
from app.geometry.camera import CameraIntrinsics

MATRIX = np.array([[1431.3, 0.0, 477.5], [0.0, 1432.2, 643.1], [0.0, 0.0, 1.0]])


def write(
    path: Path, matrix: np.ndarray, distortion: np.ndarray, size: tuple[int, int] = (960, 1280)
) -> Path:
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", size[0])
    storage.write("image_height", size[1])
    storage.write("camera_matrix", matrix)
    storage.write("distortion_coefficients", distortion)
    storage.release()
    return path


@pytest.mark.parametrize("suffix", [".yml", ".yaml", ".xml"])
def test_a_camera_of_opencv_is_read_to_the_last_bit(tmp_path: Path, suffix: str) -> None:
    distortion = np.array([[0.1, -0.2, 1e-3, -1e-3, 0.05]]).T
    camera = load_camera(write(tmp_path / f"camera{suffix}", MATRIX, distortion))
    assert_array_equal(camera.matrix, MATRIX)
    assert_array_equal(camera.distortion, distortion.ravel())
    assert camera.size == (960, 1280)


def test_four_terms_of_distortion_are_five_with_k3_zero(tmp_path: Path) -> None:
    camera = load_camera(write(tmp_path / "camera.yml", MATRIX, np.array([0.1, 0.2, 0.0, 0.0])))
    assert_array_equal(camera.distortion, [0.1, 0.2, 0.0, 0.0, 0.0])


def test_a_calibration_of_this_program_is_a_camera_too(tmp_path: Path) -> None:
    camera = CameraIntrinsics(MATRIX, np.zeros(5), (960, 1280))
    CalibrationRecord(camera=camera).save(tmp_path / "camera.json")
    assert_array_equal(load_camera(tmp_path / "camera.json").matrix, MATRIX)


@pytest.mark.parametrize(
    ("matrix", "distortion", "size", "problem"),
    [
        (-MATRIX, np.zeros(5), (960, 1280), "focal lengths"),
        (MATRIX * np.nan, np.zeros(5), (960, 1280), "nan"),
        (MATRIX[:2], np.zeros(5), (960, 1280), "camera_matrix: is missing or of another size"),
        (MATRIX, np.zeros(2), (960, 1280), "distortion_coefficients: is missing or of another size"),
        (MATRIX, np.full(8, 0.1), (960, 1280), "has terms beyond"),
        (MATRIX, np.zeros(5), (0, 1280), "image_width and image_height: is missing"),
    ],
)
def test_a_camera_that_cannot_be_is_named(
    tmp_path: Path, matrix: np.ndarray, distortion: np.ndarray, size: tuple[int, int], problem: str
) -> None:
    with pytest.raises(CalibrationFileError, match=problem):
        load_camera(write(tmp_path / "camera.yml", matrix, distortion, size))


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(CalibrationFileError, match=r"none\.yml: no such file"):
        load_camera(tmp_path / "none.yml")


@given(
    start=st.sampled_from(["", "%YAML:1.0\n---\n", '<?xml version="1.0"?>\n<opencv_storage>', '{"a": ']),
    rest=st.text(max_size=100) | st.text("camera_matrix:!![]{}<>/-. \n0123456789", max_size=100),
)
def test_no_text_is_a_surprise(tmp_path_factory: pytest.TempPathFactory, start: str, rest: str) -> None:
    path = tmp_path_factory.getbasetemp() / "camera.yml"
    path.write_text(start + rest, encoding="utf-8", errors="replace")
    with pytest.raises(CalibrationFileError):
        load_camera(path)
