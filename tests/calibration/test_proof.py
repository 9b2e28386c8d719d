"""The proof names what is wrong with a calibration, and how much."""

from dataclasses import replace

import numpy as np
import pytest

from app.calibration.proof import Proof, Verdict, prove
from app.calibration.record import CalibrationRecord
from app.calibration.views import Evidence
from app.errors import CalibrationError
from app.geometry.axis import TurntableAxis
from app.geometry.camera import CameraIntrinsics
from app.geometry.plane import LaserPlane
from app.geometry.rig import Rig
from app.geometry.transform import rotation_about
from benchmarks.synthetic_views import SyntheticViews, typical_rig

_ANGLES = (-25.0, -15.0, -5.0, 5.0, 15.0, 25.0)
RIG = typical_rig(2)


def _seen(angles: tuple[float, ...] = _ANGLES, jitter_deg: float = 0.0) -> Evidence:
    views = SyntheticViews(RIG, np.random.default_rng(1), jitter_deg=jitter_deg)
    views.placement(0, angles, 25.0, 0.0)
    return views.evidence()


SEEN = _seen()


def _record(rig: Rig, expected_mm: float = 0.01) -> CalibrationRecord:
    return CalibrationRecord(
        camera=rig.camera, lasers=rig.lasers, axis=rig.axis, expected_error_mm=expected_mm
    )


def _verdicts(proof: Proof) -> dict[str, Verdict]:
    return {finding.name: finding.verdict for finding in proof.findings}


def _value(proof: Proof, name: str) -> float:
    return next(finding.value_mm for finding in proof.findings if finding.name == name)


def _turned_laser(degrees: float) -> Rig:
    plane = RIG.lasers["left"]
    normal = rotation_about(np.array([0.0, 1.0, 0.0]), np.radians(degrees)) @ plane.normal
    return replace(
        RIG, lasers={**RIG.lasers, "left": LaserPlane.through(plane.normal * plane.distance_mm, normal)}
    )


def _moved_axis(mm: float) -> Rig:
    return replace(RIG, axis=TurntableAxis(RIG.axis.point_mm + np.array([mm, 0.0, 0.0]), RIG.axis.direction))


def test_a_true_calibration_is_good_in_everything() -> None:
    proof = prove(SEEN, _record(RIG))
    assert set(_verdicts(proof)) == {"expected", "surface", "size", "axis", "wobble", "turning", "lasers"}
    assert proof.verdict is Verdict.GOOD
    assert all(not finding.advice for finding in proof.findings)
    assert proof.stops == len(_ANGLES)
    assert _value(proof, "size") < 0.03
    assert _value(proof, "axis") < 0.05


def test_a_laser_that_was_moved_shows_as_two_surfaces() -> None:
    proof = prove(SEEN, _record(_turned_laser(0.3)))
    assert _verdicts(proof)["lasers"] is Verdict.BAD
    assert _verdicts(proof)["axis"] is Verdict.GOOD
    assert proof.verdict is Verdict.BAD


@pytest.mark.parametrize("mm", [0.2, 1.0])
def test_an_axis_that_was_moved_is_found_with_its_distance(mm: float) -> None:
    proof = prove(SEEN, _record(_moved_axis(mm)))
    assert _value(proof, "axis") == pytest.approx(mm, abs=0.05)
    assert _verdicts(proof)["axis"] is (Verdict.FAIR if mm < 0.3 else Verdict.BAD)
    assert _verdicts(proof)["wobble"] is Verdict.GOOD


def test_a_lens_that_was_zoomed_shows_as_a_wrong_size() -> None:
    matrix = RIG.camera.matrix * [[1.01], [1.01], [1.0]]
    zoomed = CameraIntrinsics(matrix, RIG.camera.distortion, RIG.camera.size)
    proof = prove(SEEN, _record(replace(RIG, camera=zoomed)))
    assert _verdicts(proof)["size"] is Verdict.BAD
    words = next(finding.words for finding in proof.findings if finding.name == "size")
    assert "%" in words


def test_a_table_that_turns_too_far_is_told_from_a_wrong_axis() -> None:
    told = tuple(angle * 0.98 for angle in _ANGLES)
    views = tuple(
        replace(view, angle_rad=np.radians(angle)) for view, angle in zip(SEEN.views, told, strict=True)
    )
    proof = prove(replace(SEEN, views=views), _record(RIG))
    assert _verdicts(proof)["turning"] is Verdict.BAD
    assert "steps" in next(f.advice for f in proof.findings if f.name == "turning")
    assert _value(proof, "axis") < 0.2


def test_a_board_that_sways_breaks_its_circle() -> None:
    views = []
    for number, view in enumerate(SEEN.views):
        shifted = replace(view.board, corners=view.board.corners + np.array([0.0, 3.0 * (-1) ** number]))
        views.append(replace(view, board=shifted))
    proof = prove(replace(SEEN, views=tuple(views)), _record(RIG))
    assert _verdicts(proof)["wobble"] is Verdict.BAD


def test_what_the_calibration_expects_of_itself_is_judged_too() -> None:
    proof = prove(SEEN, _record(RIG, expected_mm=0.2))
    assert _verdicts(proof)["expected"] is Verdict.FAIR
    assert "expected" not in _verdicts(prove(SEEN, _record(RIG, expected_mm=float("nan"))))


def test_one_laser_is_compared_with_nothing() -> None:
    rig = typical_rig(1)
    views = SyntheticViews(rig, np.random.default_rng(1), jitter_deg=0.0)
    views.placement(0, _ANGLES, 25.0, 0.0)
    assert "lasers" not in _verdicts(prove(views.evidence(), _record(rig)))


def test_a_calibration_file_keeps_the_proof() -> None:
    proof = prove(SEEN, _record(RIG))
    record = replace(_record(RIG), extra={"proof": proof.as_json()})
    kept = CalibrationRecord.parse(record.to_bytes(), "kept").extra["proof"]
    assert kept["verdict"] == "good"
    assert [entry["name"] for entry in kept["findings"]] == [f.name for f in proof.findings]


def test_too_few_angles_prove_nothing() -> None:
    with pytest.raises(CalibrationError, match="2 angles"):
        prove(_seen((-5.0, 5.0)), _record(RIG))


def test_without_a_stripe_nothing_is_proved() -> None:
    dark = replace(SEEN, views=tuple(replace(view, stripes={}) for view in SEEN.views))
    with pytest.raises(CalibrationError, match="No laser"):
        prove(dark, _record(RIG))
