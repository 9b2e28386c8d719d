"""Calibration from pictures: both methods, what they say, and their reports."""

import base64
import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from app.calibration.calibrate import calibrate, calibrate_evidence
from app.calibration.outcome import CalibrationOutcome, ViewResidual
from app.calibration.plan import CalibrationPlan
from app.calibration.record import CalibrationRecord
from app.calibration.report import report_lines, write_report
from app.calibration.views import Evidence, gather
from app.errors import CalibrationError, OptionError
from app.geometry.rig import Rig
from app.recording.reader import Recording
from app.recording.shot import Role
from app.vision.stripe import STRIPE_DETECTORS
from benchmarks.synthetic_views import surface_error_mm


@pytest.fixture(scope="module")
def evidence(small_recording: Path) -> Evidence:
    return gather([Recording.open(small_recording)], STRIPE_DETECTORS.make("zero-crossing"))


@pytest.fixture(scope="module")
def truth(small_recording: Path) -> Rig:
    return CalibrationRecord.load(small_recording / "truth.json").rig


@pytest.fixture(scope="module")
def joint(evidence: Evidence) -> CalibrationOutcome:
    return calibrate_evidence(evidence, CalibrationPlan())


def test_every_picture_of_a_board_is_looked_at(evidence: Evidence) -> None:
    roles = [view.role for view in evidence.views]
    assert roles.count(Role.INTRINSICS) == 8
    assert roles.count(Role.LASER_PLANE) == 4
    assert roles.count(Role.AXIS) == 6
    assert roles.count(Role.AXIS_LINE) == 1
    assert evidence.skipped == ()
    planes = [view for view in evidence.views if view.role in (Role.LASER_PLANE, Role.AXIS)]
    assert all(set(view.stripes) == {"left", "right"} for view in planes)


def test_the_joint_method_finds_the_scanner(joint: CalibrationOutcome, truth: Rig) -> None:
    assert joint.doubts == ()
    assert surface_error_mm(truth, joint.record.rig) < 0.03
    assert joint.record.expected_error_mm < 0.03
    assert joint.record.method == "joint"
    assert joint.axis_method == "joint"


@pytest.mark.parametrize(("axis", "off_mm"), [("line", 0.3), ("board", 0.3)])
def test_the_papers_method_finds_it_too(
    axis: str, off_mm: float, evidence: Evidence, joint: CalibrationOutcome, truth: Rig
) -> None:
    found = calibrate_evidence(evidence, CalibrationPlan("paper", axis))  # type: ignore[arg-type]
    assert found.axis_method == axis
    assert found.record.camera.distortion[4] == 0.0
    assert set(found.record.lasers) == {"left", "right"}
    error = surface_error_mm(truth, found.record.rig)
    assert surface_error_mm(truth, joint.record.rig) < error < off_mm


def test_the_paper_takes_the_line_where_there_is_one(evidence: Evidence) -> None:
    assert calibrate_evidence(evidence, CalibrationPlan("paper")).axis_method == "line"
    without = replace(
        evidence, views=tuple(view for view in evidence.views if view.role is not Role.AXIS_LINE)
    )
    assert calibrate_evidence(without, CalibrationPlan("paper")).axis_method == "board"


def test_distortion_that_is_left_out_costs_accuracy(evidence: Evidence, truth: Rig) -> None:
    with_it = calibrate_evidence(evidence, CalibrationPlan("paper", "board"))
    without = calibrate_evidence(evidence, CalibrationPlan("paper", "board", uses_distortion=False))
    assert not without.record.camera.distortion.any()
    assert surface_error_mm(truth, without.record.rig) > 2.0 * surface_error_mm(truth, with_it.record.rig)


def test_markers_that_are_not_there_give_no_axis(evidence: Evidence) -> None:
    with pytest.raises(CalibrationError, match="No markers were seen"):
        calibrate_evidence(evidence, CalibrationPlan("paper", "platter"))


def test_a_laser_that_is_never_seen_is_named(evidence: Evidence) -> None:
    dark = replace(evidence, views=tuple(replace(view, stripes={}) for view in evidence.views))
    with pytest.raises(CalibrationError, match="laser 'left' was not seen"):
        calibrate_evidence(dark, CalibrationPlan())


def test_one_of_two_lasers_that_is_never_seen_is_noted(evidence: Evidence) -> None:
    views = tuple(
        replace(view, stripes={name: s for name, s in view.stripes.items() if name == "left"})
        for view in evidence.views
    )
    for method in ("joint", "paper"):
        found = calibrate_evidence(replace(evidence, views=views), CalibrationPlan(method))
        assert set(found.record.lasers) == {"left"}
        assert any("'right' has no plane" in note for note in found.notes)


def test_a_board_that_is_never_seen_is_named(evidence: Evidence) -> None:
    with pytest.raises(CalibrationError, match="board was never seen"):
        calibrate_evidence(replace(evidence, views=()), CalibrationPlan())


def test_a_known_camera_is_not_touched(evidence: Evidence, truth: Rig) -> None:
    found = calibrate_evidence(evidence, CalibrationPlan(camera=truth.camera))
    np.testing.assert_array_equal(found.record.camera.matrix, truth.camera.matrix)
    assert surface_error_mm(truth, found.record.rig) < 0.03


def test_a_camera_for_other_pictures_is_refused(evidence: Evidence, truth: Rig) -> None:
    camera = replace(truth.camera, size=(1280, 960))
    with pytest.raises(CalibrationError, match=r"1280x960.*640x480"):
        calibrate_evidence(evidence, CalibrationPlan(camera=camera))


def test_camera_views_alone_give_a_camera(evidence: Evidence) -> None:
    views = tuple(view for view in evidence.views if view.role is Role.INTRINSICS)
    found = calibrate_evidence(replace(evidence, views=views, lasers=()), CalibrationPlan())
    assert found.record.method == "camera only"
    assert found.record.axis is None
    assert any("Only the camera" in note for note in found.notes)


def test_no_recording_is_no_calibration() -> None:
    with pytest.raises(CalibrationError, match="No recording"):
        calibrate([], STRIPE_DETECTORS.make("zero-crossing"), CalibrationPlan())


def test_progress_counts_up_to_the_end(small_recording: Path, evidence: Evidence) -> None:
    told: list[tuple[str, int]] = []
    calibrate_evidence(evidence, CalibrationPlan(), lambda stage, done, total: told.append((stage, done)))
    steps = [done for stage, done in told if stage == "Adjusting everything together"]
    assert steps == sorted(steps)
    assert len(steps) > 3


def test_the_lines_hold_the_figures(joint: CalibrationOutcome) -> None:
    text = "\n".join(report_lines(joint))
    assert f"fx {joint.record.camera.matrix[0, 0]:.1f}" in text
    assert f"{joint.record.rms_px:.3f} px RMS" in text
    assert f"{joint.record.expected_error_mm:.3f} mm at the surface" in text
    assert "nan" not in text


def picture_of(data: bytes) -> np.ndarray:
    return np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR))


def test_the_picture_decodes_and_is_drawn_on(joint: CalibrationOutcome, tmp_path: Path) -> None:
    write_report(joint, tmp_path / "report.png")
    image = picture_of((tmp_path / "report.png").read_bytes())
    assert min(image.shape[:2]) > 600
    assert image.std() > 10.0


def test_the_page_holds_lines_and_picture_and_escapes_names(
    joint: CalibrationOutcome, tmp_path: Path
) -> None:
    nasty = "<script>alert(1)</script>&.png"
    views = (
        ViewResidual(nasty, Role.AXIS, 0.1, {}, {"<b>left": 0.2}, 1.0, 1.5),
        *joint.views[1:],
    )
    outcome = replace(joint, views=views, dropped=((nasty, "<i>"),), notes=("<b>note",), doubts=("<b>doubt",))
    write_report(outcome, tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text()
    assert "<script" not in page
    assert "<b>" not in page
    assert "<i>" not in page
    assert "&lt;script&gt;alert(1)&lt;/script&gt;&amp;.png" in page
    assert f"{joint.record.rms_px:.3f} px RMS" in page
    encoded = re.search(r"data:image/png;base64,([^\"]+)", page)
    assert encoded is not None
    assert picture_of(base64.b64decode(encoded[1])).std() > 10.0


def test_a_calibration_without_views_still_has_a_report(evidence: Evidence, tmp_path: Path) -> None:
    views = tuple(view for view in evidence.views if view.role is Role.INTRINSICS)
    found = calibrate_evidence(replace(evidence, views=views, lasers=()), CalibrationPlan())
    write_report(found, tmp_path / "camera.png")
    assert "nan" not in "\n".join(report_lines(found))


def test_a_report_is_a_picture_or_a_page(joint: CalibrationOutcome, tmp_path: Path) -> None:
    with pytest.raises(OptionError, match=r"\.png or an \.html"):
        write_report(joint, tmp_path / "report.txt")
    assert list(tmp_path.iterdir()) == []
