"""Meshes of clouds whose surface is known."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from app.errors import SurfaceError
from app.geometry.cloud import PointCloud
from app.geometry.mesh import TriangleMesh
from app.surface.meshing.holes import fill_holes
from app.surface.meshing.make import make_mesh
from app.surface.meshing.options import MeshOptions
from app.surface.meshing.simplify import to_count, to_tolerance
from app.surface.meshing.topology import is_watertight, pieces_of, rim_edges, with_faces
from app.surface.normals import with_normals
from app.surface.signed_distance import distances_to_mesh

RADIUS_MM = 20.0


def test_a_ball_comes_out_closed_round_and_turned_outwards() -> None:
    mesh = make_mesh(_ball(40_000), MeshOptions(cell_mm=0.8, has_flat_base=False))
    radii = np.linalg.norm(mesh.vertices, axis=1)
    assert _is_watertight(mesh)
    assert np.sqrt(np.mean((radii - RADIUS_MM) ** 2)) < 0.02
    assert mesh.volume_mm3 == pytest.approx(4.0 / 3.0 * np.pi * RADIUS_MM**3, rel=0.002)


def test_what_was_not_seen_from_below_stands_on_a_flat_base() -> None:
    ball = _ball(40_000)
    seen = ball.select(ball.points[:, 2] > -10.0)
    mesh = make_mesh(seen, MeshOptions(cell_mm=0.8))
    assert _is_watertight(mesh)
    assert mesh.vertices[:, 2].min() == pytest.approx(-10.0, abs=0.2)


def test_an_open_mesh_ends_where_the_points_end() -> None:
    ball = _ball(40_000)
    seen = ball.select(ball.points[:, 2] > 0.0)
    mesh = make_mesh(seen, MeshOptions(cell_mm=0.8, is_closed=False, trim_mm=1.0))
    assert not _is_watertight(mesh)
    assert mesh.vertices[:, 2].min() > -1.2
    assert np.abs(np.linalg.norm(mesh.vertices, axis=1) - RADIUS_MM).max() < 0.5


def test_fewer_triangles_keep_it_closed_coloured_and_within_the_tolerance() -> None:
    ball = _ball(15_000)
    fine = make_mesh(ball, MeshOptions(cell_mm=1.2))
    within = to_tolerance(fine, 0.05)
    few = to_count(fine, 500)
    assert len(within) < 0.5 * len(fine)
    assert np.percentile(np.abs(distances_to_mesh(fine.vertices, within)), 99) <= 0.05
    assert 400 <= len(few) <= 500
    for mesh in (fine, within, few):
        assert _is_watertight(mesh)
        assert is_watertight(mesh)
        assert mesh.colours is not None
        assert np.all(mesh.colours == 90)


def test_small_holes_are_filled_and_large_ones_stay() -> None:
    whole = make_mesh(_ball(15_000), MeshOptions(cell_mm=1.2, has_flat_base=False))
    top, bottom = (np.argsort(sign * whole.vertices[:, 2])[:n] for sign, n in ((-1, 10), (1, 200)))
    gone = np.isin(whole.faces, np.concatenate([top, bottom])).any(axis=1)
    holed = with_faces(whole, whole.faces[~gone])
    filled = fill_holes(holed, 8.0)
    assert not is_watertight(filled)
    assert 0 < len(rim_edges(filled)) < len(rim_edges(holed))
    assert is_watertight(fill_holes(holed, 40.0))


def test_islands_go_and_the_thing_stays() -> None:
    ball = _ball(15_000)
    speck = replace(
        ball.select(np.arange(800)), points=ball.points[:800] * np.float32(0.1) + np.float32(30.0)
    )
    options = MeshOptions(cell_mm=1.0, is_closed=False, island_share=0.0)
    both = make_mesh(PointCloud.joined([ball, speck]), options)
    one = make_mesh(PointCloud.joined([ball, speck]), options.model_copy(update={"island_share": 0.2}))
    assert pieces_of(both).max() > 0
    assert pieces_of(one).max() == 0


def test_a_flat_layer_is_refused_when_it_is_to_stand() -> None:
    ball = _ball(5_000)
    flat = replace(ball, points=ball.points * np.array([1.0, 1.0, 0.001], np.float32))
    with pytest.raises(SurfaceError, match="flat layer"):
        make_mesh(flat)


@pytest.mark.parametrize("count", [0, 10])
def test_too_few_points_are_refused_in_plain_words(count: int) -> None:
    with pytest.raises(SurfaceError, match="points have a normal"):
        make_mesh(_ball(count))


def test_a_detail_that_the_points_cannot_carry_is_refused_and_a_sparse_ball_is_not() -> None:
    strewn = _ball(100)
    rng = np.random.default_rng(4)
    strewn = with_normals(
        replace(
            strewn, points=rng.uniform(0.0, 40.0, (100, 3)).astype(np.float32), normals=0.0 * strewn.normals
        )
    )
    for detail, is_closed in ((1.0, True), (0.5, True), (1.0, False)):
        options = MeshOptions(cell_mm=detail, is_closed=is_closed, has_flat_base=False)
        with pytest.raises(SurfaceError, match=r"apart: too few for a detail of") as refused:
            make_mesh(strewn, options)
        assert "Take a coarser detail, such as 1" in refused.value.hint
    # Its points lie four cells apart, and tell by their normals what is between.
    sparse = make_mesh(_ball(300), MeshOptions(cell_mm=1.2, has_flat_base=False))
    np.testing.assert_allclose(np.linalg.norm(sparse.vertices, axis=1), RADIUS_MM, atol=1.0)
    assert _is_watertight(sparse)


def test_a_thousand_copies_of_one_point_are_no_surface() -> None:
    with pytest.raises(SurfaceError, match="one place"):
        make_mesh(_ball(1).select(np.zeros(1000, np.intp)))


def _ball(count: int) -> PointCloud:
    rng = np.random.default_rng(1)
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = normals * (RADIUS_MM + 0.02 * rng.normal(size=(count, 1)))
    ones = np.ones(count, np.float32)
    return PointCloud(
        points.astype(np.float32), normals.astype(np.float32), np.full((count, 3), 90, np.uint8),
        0.02 * ones, np.zeros(count, np.uint8), 0.0 * ones, ones, ("left",),
    )  # fmt: skip


def _is_watertight(mesh: TriangleMesh) -> bool:
    return bool(trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).is_watertight)
