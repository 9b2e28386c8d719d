"""Finished things: from raw clouds by presets, and what is said of bad ones."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from clouds import some_cloud

from app.errors import OptionError, SurfaceError
from app.geometry.cloud import PointCloud
from app.geometry.mesh import TriangleMesh
from app.surface.exports.write import write_mesh
from app.surface.finish import Finish, Preset, finish
from app.surface.meshing.options import MeshOptions
from app.surface.meshing.topology import is_watertight
from app.surface.ply import write_ply
from app.surface.printing import State, check_print
from app.surface.thinning import read_thinned, without_copies

RADIUS_MM = 20.0


def test_a_print_is_watertight_also_as_stl_and_says_size_and_weight(tmp_path: Path) -> None:
    done = finish([_scanned_ball(15_000)], _order(Preset.PRINT, tolerance_mm=0.05))
    assert done.mesh is not None
    write_mesh(tmp_path / "ball.stl", done.mesh)
    assert trimesh.load_mesh(tmp_path / "ball.stl").is_watertight
    printing = done.report.printing
    assert printing is not None
    assert printing.is_printable
    assert {finding.state for finding in printing.findings} == {State.GOOD}
    assert printing.size_mm[0] == pytest.approx(2 * RADIUS_MM, abs=0.2)
    assert printing.volume_cm3 == pytest.approx(4 / 3 * np.pi * (RADIUS_MM / 10) ** 3, rel=0.02)
    assert printing.pla_g == pytest.approx(1.24 * printing.volume_cm3)
    assert done.report.notes == done.report.doubts == ()


@pytest.mark.parametrize("preset", [Preset.ARCHIVE, Preset.MEASURE])
def test_other_presets_invent_no_surface(preset: Preset) -> None:
    done = finish([_scanned_ball(15_000)], _order(preset))
    assert done.mesh is not None
    assert done.mesh.vertices[:, 2].min() > 0.5
    assert not is_watertight(done.mesh)
    assert done.report.printing is None


def test_half_a_ball_is_finished_but_not_to_be_trusted() -> None:
    ball = _scanned_ball(15_000)
    done = finish([ball.select(ball.points[:, 0] > 8.0)], _order(Preset.PRINT))
    assert any("is a guess" in doubt for doubt in done.report.doubts)


def test_points_strewn_about_are_doubted() -> None:
    rng = np.random.default_rng(4)
    strewn = _scanned_ball(500)
    nowhere = rng.uniform(0.0, 40.0, strewn.points.shape).astype(np.float32)
    done = finish([replace(strewn, points=nowhere, normals=0.0 * strewn.normals)], Finish(steps=()))
    assert any("lie on no surface" in doubt for doubt in done.report.doubts)


def test_points_of_other_programs_get_normals_and_that_is_said() -> None:
    ball = _scanned_ball(10_000)
    bare = replace(ball, normals=np.zeros_like(ball.normals))
    done = finish([bare], _order(Preset.PRINT))
    assert np.mean(np.einsum("ij,ij->i", done.cloud.normals, ball.normals) > 0.9) > 0.99
    assert "came without normals" in done.report.notes[0]


def test_copies_and_points_at_no_place_are_left_out() -> None:
    ball = _scanned_ball(5_000)
    lost = replace(ball.select(np.arange(10)), points=np.full((10, 3), np.nan, np.float32))
    many = PointCloud.joined([ball, ball.select(np.zeros(200_000, np.intp)), lost])
    assert len(without_copies(many)) == len(ball)
    with pytest.raises(SurfaceError, match="1 different places"):
        finish([ball.select(np.zeros(1_000, np.intp))])
    with pytest.raises(SurfaceError, match="0 different places"):
        finish([PointCloud.empty()])
    with pytest.raises(SurfaceError, match=r"lie up to 4e\+29 mm apart; a surface may be 1e\+07 mm wide"):
        finish([replace(ball, points=ball.points * np.float32(1e28))])


def test_too_many_points_are_thinned_evenly(tmp_path: Path) -> None:
    cloud = some_cloud(1_000)
    write_ply(tmp_path / "cloud.ply", cloud)
    read = read_thinned(tmp_path / "cloud.ply", 300)
    assert read.points == 1_000
    np.testing.assert_array_equal(read.cloud.points, cloud.points[::4])
    done = finish([_scanned_ball(3_000)], Finish(has_mesh=False, steps=(), most_points=1_000))
    assert len(done.cloud) <= 1_000
    assert done.report.thinned >= 1_000


def test_steps_that_leave_nothing_are_named() -> None:
    nothing = Finish(steps=({"kind": "quality", "least": 1.0},))
    ball = _scanned_ball(500)
    with pytest.raises(SurfaceError, match="steps left 0"):
        finish([replace(ball, quality=np.zeros_like(ball.quality))], nothing)
    with pytest.raises(OptionError, match="magic"):
        finish([ball], Finish(steps=({"kind": "magic"},)))


def test_an_open_mesh_and_loose_pieces_are_found_before_printing() -> None:
    box = trimesh.creation.box((10.0, 10.0, 0.3))
    thin = TriangleMesh(box.vertices.astype(np.float32), box.faces.astype(np.int32))
    two = TriangleMesh(
        np.concatenate([thin.vertices, thin.vertices + np.float32(40.0)]),
        np.concatenate([thin.faces, thin.faces + np.int32(8)]),
    )
    states = {finding.check: finding.state for finding in check_print(two).findings}
    assert states["watertight"] == State.GOOD
    assert states["pieces"] == states["walls"] == State.DOUBT
    assert check_print(two).wall_mm == pytest.approx(0.3, abs=0.02)
    opened = check_print(replace(thin, faces=thin.faces[1:]))
    assert not opened.is_printable
    assert all(finding.advice for finding in opened.findings if finding.state is not State.GOOD)
    assert not check_print(TriangleMesh.empty()).is_printable


def _order(preset: Preset, tolerance_mm: float | None = None) -> Finish:
    closed = preset is Preset.PRINT
    options = MeshOptions(is_closed=closed, cell_mm=1.5, tolerance_mm=tolerance_mm)
    return Finish(preset=preset, steps=(), mesh=options)


def _scanned_ball(count: int) -> PointCloud:
    """On the table, with what lies below its lowest 2 mm not seen."""
    rng = np.random.default_rng(1)
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = normals * (RADIUS_MM + 0.02 * rng.normal(size=(count, 1))) + [0.0, 0.0, RADIUS_MM]
    ones = np.ones(count, np.float32)
    cloud = PointCloud(
        points.astype(np.float32), normals.astype(np.float32), np.full((count, 3), 90, np.uint8),
        0.02 * ones, np.zeros(count, np.uint8), 0.0 * ones, ones, ("left",),
    )  # fmt: skip
    return cloud.select(points[:, 2] > 2.0)
