"""A real scanner goes through whole: calibrated from its pictures, its empty table comes out flat and closed.

The known values are those of `data/README.md`. Corners alone give the camera 0.139 px in
`calibration/test_intrinsics_real.py`; here laser and markers have their say too.
"""

import io
import re
from contextlib import redirect_stderr
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from app.calibration.platter_file import layout_of
from app.calibration.record import CalibrationRecord
from app.cli.main import run
from app.geometry.arrays import Floats
from app.geometry.cloud import PointCloud
from app.surface.ply_reader import read_ply


@dataclass(frozen=True, eq=False)
class Outcome:
    """What the two commands left behind.

    Attributes:
        codes: exit codes of calibrate and reconstruct.
        said: what they told, spaces evened.
    """

    codes: tuple[int, int]
    record: CalibrationRecord
    cloud: PointCloud
    said: str


@pytest.fixture(scope="module")
def green(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    out = tmp_path_factory.mktemp("green")
    recording, calibration, cloud = shared_data / "turntable-green", out / "rig.json", out / "table.ply"
    codes, said = [], io.StringIO()
    for command in (
        ["calibrate", str(recording), "-o", str(calibration)],
        ["reconstruct", str(recording), "-c", str(calibration), "-o", str(cloud)],
    ):
        with redirect_stderr(said):
            codes.append(run(command))
    told = " ".join(said.getvalue().split())
    return Outcome((codes[0], codes[1]), CalibrationRecord.load(calibration), read_ply(cloud), told)


def table_points(cloud: PointCloud) -> Floats:
    """Points (N, 3) of the table itself: within 100 mm of the axis, not of the screws and the wall behind."""
    points = cloud.points.astype(np.float64)
    return points[(np.hypot(points[:, 0], points[:, 1]) < 100.0) & (np.abs(points[:, 2]) < 8.0)]


def test_both_commands_end_well(green: Outcome) -> None:
    assert green.codes == (0, 0)
    assert len(green.cloud) > 15_000


def test_the_camera_is_the_published_one(green: Outcome) -> None:
    assert green.record.camera.matrix[0, 0] == pytest.approx(621.4, abs=1.3)
    assert green.record.camera.distortion[0] == pytest.approx(0.11, abs=0.01)
    views = [v["corner_px"] for v in green.record.extra["views"] if v["role"] == "intrinsics"]
    assert len(views) == 27
    assert np.sqrt(np.mean(np.square(views))) == pytest.approx(0.139, abs=0.003)


def test_the_laser_lies_on_its_plane(green: Outcome) -> None:
    assert green.record.laser_rms_mm["green"] <= 0.39


def test_the_markers_are_one_rigid_sheet_on_one_axis(green: Outcome) -> None:
    stops = [v["corner_px"] for v in green.record.extra["views"] if v["role"] == "scan"]
    assert len(stops) == 160
    assert np.sqrt(np.mean(np.square(stops))) <= 0.70


def test_the_axis_points_where_it_did_before(green: Outcome) -> None:
    assert green.record.axis is not None
    assert_allclose(green.record.axis.direction, (0.038, -0.924, -0.380), atol=0.01)


def test_the_sheet_lies_four_millimetres_off_the_axis(green: Outcome) -> None:
    layout = layout_of(green.record)
    assert sorted(layout) == [5, 18, 27, 42]
    centre = np.mean([corners.mean(axis=0) for corners in layout.values()], axis=0)
    assert np.hypot(*centre[:2]) == pytest.approx(4.1, abs=0.2)


def test_the_markers_were_printed_smaller_than_stated(green: Outcome) -> None:
    assert green.record.extra["platter"]["marker_mm"] == pytest.approx(29.4, abs=0.2)
    assert "not the 30 mm that the recording states" in green.said


def test_the_empty_table_is_flat_and_at_zero(green: Outcome) -> None:
    points = table_points(green.cloud)
    flat = np.column_stack([points[:, :2], np.ones(len(points))])
    off = points[:, 2] - flat @ np.linalg.lstsq(flat, points[:, 2], rcond=None)[0]
    assert np.sqrt(np.mean(off**2)) <= 0.35
    assert abs(np.median(points[:, 2])) <= 0.5


def test_the_table_is_closed_over_the_whole_turn(green: Outcome) -> None:
    points = table_points(green.cloud)
    sector = np.degrees(np.arctan2(points[:, 1], points[:, 0])) // 5.0
    assert len(np.unique(sector)) == 72


def test_the_lost_steps_are_reported(green: Outcome) -> None:
    assert "the motor lost steps" in green.said
    found = re.search(r"([\d.]+) degrees RMS from what was commanded, ([\d.]+) at most", green.said)
    assert found is not None
    assert float(found[2]) == pytest.approx(1.8, abs=0.3)
    last = re.search(r"the first being number (\d+) and the last (\d+)", green.said)
    assert last is not None
    assert int(last[2]) <= 60
