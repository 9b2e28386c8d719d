"""A scanner that has changed since its calibration says so, and names what moved; a healthy one is silent."""

from dataclasses import replace

import numpy as np
import pytest
from small_scans import SmallScan, make_small_scan

from app.geometry.axis import TurntableAxis
from app.geometry.plane import LaserPlane
from app.geometry.rig import Rig
from app.geometry.transform import rotation_from_rvec
from app.scanning.agreement import LaserAgreement
from app.scanning.drift import Drift, DriftLevel, DriftReference, find_drift
from app.scanning.report import ReconstructionReport
from app.scanning.sources import reconstruct_recording, scan_detector
from app.scanning.table import TableCheck

_NAN = float("nan")


@pytest.fixture(scope="module")
def scan(tmp_path_factory: pytest.TempPathFactory) -> SmallScan:
    return make_small_scan(tmp_path_factory.mktemp("drift"))


def _found(reference: DriftReference | None = None, **heights_mm: float) -> Drift:
    tables = {name: TableCheck("points", mm, 0.0, 0.05, 1000) for name, mm in heights_mm.items()}
    return find_drift(tables, (), _NAN, reference)


def _seen_with(scan: SmallScan, rig: Rig) -> ReconstructionReport:
    run = reconstruct_recording(scan.recording, rig, scan_detector())
    for _ in run:
        pass
    return run.report()


def test_a_healthy_scan_is_silent(scan: SmallScan) -> None:
    report = scan.reports[0]
    assert report.drift.level is DriftLevel.OK
    assert {finding.name for finding in report.drift.findings} >= {"table-apart", "table-height", "markers"}
    assert report.drift.sentences == ()
    assert report.doubts == ()


def test_a_laser_that_was_turned_by_a_third_of_a_degree_is_found_and_named(scan: SmallScan) -> None:
    rig = scan.plan.scanner.rig
    plane = rig.lasers["left"]
    turn = rotation_from_rvec(np.radians(0.3) * rig.axis.direction)
    turned = LaserPlane.through(plane.normal * plane.distance_mm, turn @ plane.normal)
    report = _seen_with(scan, replace(rig, lasers={**rig.lasers, "left": turned}))
    worst = report.drift.findings[0]
    assert (worst.level, worst.name, worst.cause, worst.laser) == (
        DriftLevel.DRIFTED, "table-apart", "laser-moved", "left",
    )  # fmt: skip
    assert "laser 'left' has moved" in report.doubts[0]
    assert "calibrate again" in report.doubts[0]


def test_a_camera_that_was_nudged_is_found(scan: SmallScan) -> None:
    rig = scan.plan.scanner.rig
    turn = rotation_from_rvec(np.radians([0.3, 0.0, 0.0]))
    axis = TurntableAxis(turn @ rig.axis.point_mm, turn @ rig.axis.direction, rig.axis.offset_mm)
    drift = _seen_with(scan, replace(rig, axis=axis)).drift
    assert drift.level is DriftLevel.DRIFTED
    assert "camera-or-table-moved" in {finding.cause for finding in drift.findings}


def test_what_was_so_at_the_calibration_is_no_drift() -> None:
    was = DriftReference({"left": 0.5, "right": -0.1})
    assert _found(left=0.5, right=-0.1).level is DriftLevel.DRIFTED
    assert _found(was, left=0.52, right=-0.12).level is DriftLevel.OK
    assert DriftReference.kept_in({"drift": was.as_json()}) == was
    assert DriftReference.kept_in({"drift": [1]}) is None


@pytest.mark.parametrize(
    ("left", "right", "cause", "laser"),
    [
        (-1.0, 0.01, "laser-moved", "left"),
        (0.02, 0.7, "laser-moved", "right"),
        (1.3, -1.3, "camera-moved", ""),
        (1.2, 1.25, "camera-or-table-moved", ""),
    ],
)
def test_the_heights_at_which_lasers_see_the_table_tell_what_moved(
    left: float, right: float, cause: str, laser: str
) -> None:
    worst = _found(left=left, right=right).findings[0]
    assert (worst.level, worst.cause, worst.laser) == (DriftLevel.DRIFTED, cause, laser)


def test_a_sheet_of_paper_on_the_table_is_no_drift_and_a_mat_is_worth_a_word() -> None:
    assert _found(left=0.1, right=0.1).level is DriftLevel.OK
    assert _found(left=0.6, right=0.6).level is DriftLevel.WATCH
    assert "something flat" in _found(left=0.6, right=0.6).sentences[0]


def test_lasers_that_disagree_on_the_object_tell_where_no_table_is_seen() -> None:
    pair = LaserAgreement("left", "right", 500, 0.5, np.zeros(3), 0.1)
    drift = find_drift({}, [pair], _NAN)
    assert (drift.level, drift.findings[0].name) == (DriftLevel.DRIFTED, "lasers-apart")
    assert drift.as_json()["findings"][0]["value"] == 0.5
