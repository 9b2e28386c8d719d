"""Files for OpenCV's programs are read by OpenCV, to the last bit."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from app.calibration.camera_file import load_camera
from app.calibration.foreign.opencv import as_opencv
from app.calibration.record import CalibrationRecord
from app.errors import OptionError
from app.simulation.rig import standard_rig

RIG = standard_rig().rig
NAMES = ('left "red"\n', "rechts: größer <&>")
RECORD = CalibrationRecord(
    camera=RIG.camera,
    lasers=dict(zip(NAMES, RIG.lasers.values(), strict=True)),
    axis=RIG.axis,
    rms_px=0.2134567890123,
    laser_rms_mm={NAMES[0]: 0.05},
    axis_rms_mm=0.03,
    expected_error_mm=0.02,
)


@pytest.mark.parametrize("ending", [".yml", ".yaml", ".xml"])
def test_everything_is_read_back_as_it_was(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"rig{ending}"
    path.write_bytes(as_opencv(RECORD, ending))
    assert_array_equal(load_camera(path).matrix, RIG.camera.matrix)
    assert_array_equal(load_camera(path).distortion, RIG.camera.distortion)
    assert load_camera(path).size == RIG.camera.size
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    assert storage.getNode("avg_reprojection_error").real() == RECORD.rms_px
    assert storage.getNode("expected_error_mm").real() == RECORD.expected_error_mm
    lasers = storage.getNode("lasers")
    assert lasers.size() == 2
    for number, (name, plane) in enumerate(RECORD.lasers.items()):
        laser = lasers.at(number)
        assert laser.getNode("name").string() == name
        assert_array_equal(laser.getNode("normal").mat().ravel(), plane.normal)
        assert laser.getNode("distance_mm").real() == plane.distance_mm
    assert lasers.at(0).getNode("rms_mm").real() == 0.05
    assert lasers.at(1).getNode("rms_mm").empty()
    axis = storage.getNode("axis")
    assert_array_equal(axis.getNode("point_mm").mat().ravel(), RIG.axis.point_mm)
    assert_array_equal(axis.getNode("direction").mat().ravel(), RIG.axis.direction)
    assert axis.getNode("table_offset_mm").real() == RIG.axis.offset_mm
    storage.release()


def test_what_is_unknown_is_not_written(tmp_path: Path) -> None:
    path = tmp_path / "camera.yml"
    path.write_bytes(as_opencv(CalibrationRecord(camera=RIG.camera)))
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    assert storage.getNode("axis").empty()
    assert storage.getNode("avg_reprojection_error").empty()
    assert storage.getNode("lasers").size() == 0
    storage.release()
    assert np.isfinite(load_camera(path).matrix).all()


def test_another_ending_is_refused() -> None:
    with pytest.raises(OptionError, match="no file of OpenCV"):
        as_opencv(RECORD, ".txt")
