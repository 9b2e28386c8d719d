"""Recordings that nobody took, with the truth beside them."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.calibration.record import CalibrationRecord
from app.errors import OptionError, OutputError
from app.geometry.axis import TurntableAxis
from app.geometry.rig import Rig
from app.recording.reader import Recording
from app.recording.shot import Role
from app.recording.simulated import simulate_recording
from app.recording.simulated_plan import AngleError, SimulationPlan, Views
from app.simulation.objects import make_object
from app.simulation.rig import SimulatedRig, standard_rig
from app.vision.markers import PlatterSpec

SMALL = standard_rig(320, 180)
FEW = Views(intrinsics=3, laser_plane=2, placements=2, angles_deg=(-15.0, 0.0, 15.0))


def plan(**changes: Any) -> SimulationPlan:
    return replace(SimulationPlan(scanner=SMALL, views=FEW, steps=4, seed=3), **changes)


def truth_of(folder: Path) -> dict[str, Any]:
    document: dict[str, Any] = json.loads((folder / "truth.json").read_text())
    return document


def bytes_of(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def test_a_thing_that_is_tipped_over_stands_on_the_table_where_it_should() -> None:
    mug = make_object("mug")
    for tilt_deg, height_mm in ((0.0, 72.0), (90.0, 66.0), (180.0, 72.0)):
        placed = plan(item=mug, tilt_deg=tilt_deg, at_mm=(5.0, -3.0)).table_from_item @ mug.mesh.vertices
        low, high = placed.min(axis=0), placed.max(axis=0)
        assert low[2] == pytest.approx(0.0, abs=1e-9)
        assert high[2] == pytest.approx(height_mm, abs=0.1)
        if tilt_deg:
            np.testing.assert_allclose((low + high)[:2] / 2.0, [5.0, -3.0], atol=1e-9)
    with pytest.raises(OptionError, match="tipped over"):
        plan(tilt_deg=float("nan"))


def test_a_recording_holds_every_role_and_reads_back(tmp_path: Path) -> None:
    simulate_recording(tmp_path / "r", plan(views=replace(FEW, axis_line=2), background_steps=2))
    recording = Recording.open(tmp_path / "r")
    roles = [entry.role for entry in recording.entries]

    assert {role: roles.count(role) for role in Role} == {
        Role.INTRINSICS: 3,
        Role.LASER_PLANE: 2 * 3,
        Role.AXIS: 2 * 3 * 3,
        Role.AXIS_LINE: 2 * 2,
        Role.BACKGROUND: 2 * 2,
        Role.SCAN: 4 * 2,
        Role.TEXTURE: 4,
    }
    assert {entry.pose for entry in recording.entries if entry.role is Role.AXIS} == {0, 1}
    assert [e.angle_deg for e in recording.entries if e.role is Role.TEXTURE] == [0.0, 90.0, 180.0, 270.0]
    assert (tmp_path / "r" / "truth.stl").stat().st_size > 1000


def test_the_truth_is_a_calibration_that_can_be_used(tmp_path: Path) -> None:
    simulate_recording(tmp_path / "r", plan(parts=("scan",)))
    record = CalibrationRecord.load(tmp_path / "r" / "truth.json")

    assert np.array_equal(record.rig.camera.matrix, SMALL.rig.camera.matrix)
    for name, plane in SMALL.rig.lasers.items():
        assert np.array_equal(record.rig.lasers[name].normal, plane.normal)
        assert record.rig.lasers[name].distance_mm == plane.distance_mm
    assert record.rig.axis.offset_mm == SMALL.rig.axis.offset_mm
    truth = truth_of(tmp_path / "r")["truth"]
    assert len(truth["frames"]) == 12
    assert truth["object"]["in_object_frame"]["radius_mm"] == 30.0
    assert truth["object"]["centre_mm"] == pytest.approx([5.25, -3.0, 30.0])


def test_the_same_seed_gives_the_same_bytes_whatever_the_number_of_workers(tmp_path: Path) -> None:
    simulate_recording(tmp_path / "a", plan(steps=2), workers=1)
    simulate_recording(tmp_path / "b", plan(steps=2), workers=3)
    simulate_recording(tmp_path / "c", plan(steps=2, seed=4))
    first, second, third = (bytes_of(tmp_path / name) for name in "abc")

    assert first == second
    assert first.keys() == third.keys()
    assert first["frames/000000.png"] != third["frames/000000.png"]


def test_the_truth_knows_where_the_platform_really_stood(tmp_path: Path) -> None:
    error = AngleError(jitter_deg=0.05, lost_steps=3, lost_deg=1.0)
    recording = simulate_recording(
        tmp_path / "r", plan(parts=("scan",), steps=12, lasers=("left",), texture_every=0, angle_error=error)
    )
    true = np.array([frame["angle_deg"] for frame in truth_of(tmp_path / "r")["truth"]["frames"]])
    told = np.array([entry.angle_deg for entry in recording.entries], np.float64)

    behind = told - true
    assert behind[-1] == pytest.approx(3.0, abs=0.3)
    assert (np.diff(behind) > -0.4).all()
    assert np.std(behind - np.round(behind)) > 0.01


def test_a_clockwise_table_mirrors_the_angles(tmp_path: Path) -> None:
    options: dict[str, Any] = {
        "parts": ("scan",), "item": make_object("cube"), "angle_error": AngleError(0.0), "lasers": ("left",),
        "texture_every": 0,
    }  # fmt: skip
    there = simulate_recording(tmp_path / "ccw", plan(**options))
    back = simulate_recording(tmp_path / "cw", plan(**options, direction="cw"))
    pictures = [
        {e.angle_deg: recording.load(e).image for e in recording.entries} for recording in (there, back)
    ]

    # At 90 degrees of one the object stands as at 270 degrees of the other, but for the noise.
    off = pictures[0][90.0].astype(int) - pictures[1][270.0]
    assert np.abs(off).mean() < 3.0
    assert np.abs(pictures[0][90.0].astype(int) - pictures[1][90.0]).max() > 50


def test_a_table_that_turns_steadily_has_times_and_no_angles(tmp_path: Path) -> None:
    recording = simulate_recording(
        tmp_path / "r", plan(parts=("scan",), steps=6, lasers=("right",), seconds_per_turn=12.0)
    )

    assert [entry.time_s for entry in recording.entries] == pytest.approx([0.0, 2.0, 4.0, 6.0, 8.0, 10.0])
    assert all(entry.angle_deg is None for entry in recording.entries)
    assert all(entry.lasers_on == ("right",) for entry in recording.entries)


def test_jpeg_grey_and_markers_on_request(tmp_path: Path) -> None:
    recording = simulate_recording(
        tmp_path / "r",
        plan(
            parts=("scan",), steps=2, image_format="jpeg", quality=90, is_grey=True,
            platter=PlatterSpec("DICT_4X4_50", 12.0, (0, 1, 2)), scanner=standard_rig(640, 480),
        ),
    )  # fmt: skip

    assert {Path(entry.file).suffix for entry in recording.entries} == {".jpg"}
    assert recording.manifest.platter_spec().ids == (0, 1, 2)
    assert set(truth_of(tmp_path / "r")["truth"]["platter"]) == {"0", "1", "2"}


def test_calibration_and_scan_can_be_written_apart(tmp_path: Path) -> None:
    calibration = simulate_recording(tmp_path / "calibration", plan(parts=("calibration",)))
    scan = simulate_recording(tmp_path / "scan", plan(parts=("scan",)))

    assert {e.role for e in calibration.entries} == {Role.INTRINSICS, Role.LASER_PLANE, Role.AXIS}
    assert {e.role for e in scan.entries} == {Role.SCAN, Role.TEXTURE}
    assert scan.manifest.board is None
    assert not (tmp_path / "calibration" / "truth.stl").exists()


def test_the_laser_of_the_papers_method_shines_through_the_axis_or_as_the_hand_left_it(
    tmp_path: Path,
) -> None:
    perfect = plan(views=replace(FEW, axis_line=1)).as_set_up().scanner.rig
    by_hand = plan(views=replace(FEW, axis_line=1, hand_mm=0.5, hand_deg=0.3)).as_set_up().scanner.rig
    along = SMALL.rig.axis.origin + np.array([[0.0], [40.0]]) * SMALL.rig.axis.direction

    assert np.abs(perfect.lasers["left"].signed_distance(along)).max() < 1e-9
    assert 0.001 < np.abs(by_hand.lasers["left"].signed_distance(along)).max() < 3.0


def test_a_calibrated_rig_of_another_size_can_be_simulated(tmp_path: Path) -> None:
    """Twice as far away, and nobody has measured where the table is."""
    rig = SMALL.rig
    larger = Rig(
        rig.camera,
        {n: replace(p, distance_mm=2.0 * p.distance_mm) for n, p in rig.lasers.items()},
        TurntableAxis(2.0 * rig.axis.point_mm, rig.axis.direction),
    )
    scanner = SimulatedRig.around(larger, {"left": "green"})
    recording = simulate_recording(tmp_path / "r", plan(scanner=scanner, steps=1))

    assert scanner.table_radius_mm > 100.0
    assert recording.manifest.board_spec().spacing_mm > 15.0
    lit = next(recording.load(e).image for e in recording.entries if e.lasers_on == ("left",))
    dark = next(recording.load(e).image for e in recording.entries if e.role is Role.LASER_PLANE)
    assert (lit.astype(int) - dark)[:, :, 1].max() > 60


def test_progress_counts_every_frame(tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    simulate_recording(
        tmp_path / "r", plan(parts=("scan",), steps=2), lambda done, total: seen.append((done, total))
    )

    assert seen == [(n, 6) for n in range(1, 7)]


def test_an_interrupted_simulation_leaves_nothing_behind(tmp_path: Path) -> None:
    def interrupt(done: int, total: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate_recording(tmp_path / "r", plan(parts=("scan",)), interrupt)
    assert not (tmp_path / "r").exists()


def test_a_folder_that_holds_something_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("keep")

    with pytest.raises(OutputError):
        simulate_recording(tmp_path, plan())
    assert [p.name for p in tmp_path.iterdir()] == ["mine.txt"]


@pytest.mark.parametrize(
    "changes",
    [
        {"lasers": ("middle",)},
        {"steps": 0},
        {"seconds_per_turn": 5.0},
        {"seconds_per_turn": float("nan")},
        {"quality": 0},
        {"parts": ()},
        {"seed": -1},
    ],
)
def test_a_plan_that_cannot_be_carried_out_is_refused(changes: dict[str, Any]) -> None:
    with pytest.raises(OptionError):
        plan(**changes)
