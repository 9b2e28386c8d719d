"""`turnscan surface` as a person runs it."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from command_line import files_below, turnscan

from app.geometry.cloud import PointCloud
from app.surface.ply import write_ply
from app.surface.ply_reader import read_ply


@pytest.fixture(scope="module")
def ball(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A ball on the table, 30 mm across, its underside not seen."""
    rng = np.random.default_rng(1)
    normals = rng.normal(size=(8_000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = normals * (15.0 + 0.02 * rng.normal(size=(8_000, 1))) + [0.0, 0.0, 15.0]
    path = tmp_path_factory.mktemp("clouds") / "ball.ply"
    write_ply(path, cloud_of(points, normals).select(points[:, 2] > 2.0))
    return path


@pytest.fixture(scope="module")
def potato(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A thing without two like sides, about 40 mm across: standing, and tipped over by 90 degrees."""
    rng = np.random.default_rng(2)
    towards = rng.normal(size=(6_000, 3))
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    surface, step = _potato(towards), 1e-4
    along = [_potato(towards + step * axis) - surface for axis in np.eye(3)]
    # Of the three changes, two span the surface: the normal is across all.
    slopes = np.stack(along, axis=2) / step
    normals = np.linalg.svd(slopes)[0][:, :, 2]
    normals *= np.sign(np.sum(normals * towards, axis=1))[:, None]
    folder = tmp_path_factory.mktemp("potato")
    paths = []
    tips = (np.eye(3), np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]))
    for number, tip in enumerate(tips):
        points, turned = surface @ tip.T, normals @ tip.T
        points = points + 0.02 * rng.normal(size=(len(points), 1)) * turned
        points -= [3.0 * number, 2.0, points[:, 2].min()]
        seen = (turned[:, 2] > -0.5) & (points[:, 2] > 1.0)
        paths.append(folder / f"side{number}.ply")
        write_ply(paths[-1], cloud_of(points, turned).select(seen))
    return paths[0], paths[1]


def _potato(towards: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Its surface in these directions, (N, 3) mm."""
    x, y, z = (towards / np.linalg.norm(towards, axis=1, keepdims=True)).T
    radius = (
        18.0 + 3.0 * x + 4.0 * x * y + 3.0 * z * z * y - 3.0 * z * x * x + 2.0 * np.sin(5.0 * x + 2.0 * z)
    )
    return np.asarray(np.column_stack([x, y, z]) * radius[:, None])


def cloud_of(points: np.ndarray[Any, Any], normals: np.ndarray[Any, Any]) -> PointCloud:
    """As a scan of this program would have it, grey."""
    ones = np.ones(len(points), np.float32)
    return PointCloud(
        points.astype(np.float32), normals.astype(np.float32), np.full((len(points), 3), 90, np.uint8),
        0.02 * ones, np.zeros(len(points), np.uint8), 0.0 * ones, ones, ("left",),
    )  # fmt: skip


def test_a_ball_becomes_files_to_print_and_a_clean_cloud(ball: Path, tmp_path: Path) -> None:
    stl, three_mf, clean = tmp_path / "b.stl", tmp_path / "b.3mf", tmp_path / "clean.xyz"
    ended = turnscan(
        "surface", ball, "-o", stl, "-o", three_mf, "--clean", clean, "--detail", 1.2, "--triangles", 900,
        "--step", "quality:least=0.5", "--step", "statistical-outliers",
    )  # fmt: skip
    assert ended.code == 0, ended.said
    for path in (stl, three_mf):
        mesh = trimesh.load_mesh(path)
        assert mesh.is_watertight
        assert len(mesh.faces) <= 900
    assert files_below(tmp_path) == {"b.stl", "b.3mf", "clean.xyz"}
    for words in ("Points", "Cleaned quality: 0 left out", "statistical-outliers", "g of PLA", "Written"):
        assert words in ended.said


def test_points_that_are_nowhere_are_left_out_and_that_is_said(ball: Path, tmp_path: Path) -> None:
    cloud = read_ply(ball)
    cloud.points[::100] = np.nan
    write_ply(tmp_path / "holed.ply", cloud)
    obj = tmp_path / "b.obj"
    ended = turnscan("surface", tmp_path / "holed.ply", "-o", obj, "--detail", 1.2, "--texture", 256)
    assert ended.code == 0, ended.said
    assert f"Copies {-(-len(cloud) // 100)} points left out: not finite" in ended.said
    assert files_below(tmp_path) == {"holed.ply", "b.obj", "b.mtl", "b-texture.png"}
    read = trimesh.load_mesh(obj)
    read.merge_vertices(merge_tex=True)
    assert read.is_watertight


def test_half_a_ball_ends_with_a_doubt_and_open_without(ball: Path, tmp_path: Path) -> None:
    cloud = read_ply(ball)
    half = tmp_path / "half.ply"
    write_ply(half, cloud.select(cloud.points[:, 0] > 6.0))
    options = ("surface", half, "-o", tmp_path / "h.glb", "--no-steps", "--detail", 1.2)
    closed = turnscan(*options)
    assert closed.code == 1
    assert "is a guess" in closed.said
    assert turnscan(*options, "--open", "--holes", 3).code == 0


def test_two_scans_are_joined_before_they_become_a_thing(potato: tuple[Path, Path], tmp_path: Path) -> None:
    upright, lying = potato
    options = ("-o", tmp_path / "p.stl", "--detail", 1.2, "--joined", tmp_path / "both.ply")
    ended = turnscan("surface", upright, lying, *options)
    assert ended.code == 0, ended.said
    for words in ("Joined 2 clouds, residual 0.0", "side1.ply:", "% of it lies on the others", "both.ply"):
        assert words in ended.said
    whole = trimesh.load_mesh(tmp_path / "p.stl")
    assert whole.is_watertight
    # Closed roundly where it was seen from below.
    assert np.ptp(whole.vertices[whole.vertices[:, 2] < whole.bounds[0, 2] + 0.05], axis=0).max() < 8.0
    both = read_ply(tmp_path / "both.ply")
    # The underside of the first scan came with the second.
    assert np.count_nonzero(both.normals[:, 2] < -0.9) > 100


def test_clouds_that_lie_in_one_frame_are_taken_as_they_are(ball: Path, tmp_path: Path) -> None:
    cloud = read_ply(ball)
    halves = []
    for number, is_here in enumerate((cloud.points[:, 0] > 0.0, cloud.points[:, 0] <= 0.0)):
        halves.append(tmp_path / f"half{number}.ply")
        names = ("left",) if number else ("right",)
        write_ply(halves[-1], replace(cloud.select(is_here), laser_names=names))
    options = ("-o", tmp_path / "b.stl", "--detail", 1.2, "--no-steps")
    ended = turnscan("surface", *halves, *options, "--no-join")
    assert ended.code == 0, ended.said
    assert f"Points {len(cloud):,}" in ended.said


def test_wrong_wishes_are_refused_before_any_work(ball: Path, tmp_path: Path) -> None:
    stl = tmp_path / "b.stl"
    flat = tmp_path / "empty.ply"
    write_ply(flat, PointCloud.empty())
    cases: list[tuple[tuple[object, ...], str]] = [
        ((ball, "-o", tmp_path / "b.step"), ".step: that is no form of a mesh"),
        ((ball, "-o", stl, "--clean", tmp_path / "c.stl"), "that is no form of a cloud"),
        ((ball, "-o", tmp_path / "no" / "b.stl"), "is not there"),
        ((ball, "-o", stl, "--step", "magic"), "There is no step called 'magic'. There are:"),
        ((ball, "-o", stl, "--step", "quality:least"), "'least' is no setting"),
        ((ball, "-o", stl, "--step", "quality:least=7"), "least"),
        ((ball, "-o", stl, "--step", "quality", "--no-steps"), "contradict"),
        ((ball, "-o", stl, "--detail", -1), "--detail cannot be -1"),
        ((flat, "-o", stl), "0 different places"),
        ((ball, "-o", stl, "--joined", tmp_path / "c.ply"), "--joined and --pair are for several clouds"),
        ((ball, ball, "-o", stl, "--no-join", "--pair", "2:1,2,3=1,2,3"), "Name two clouds"),
        ((ball, ball, "-o", stl, "--pair", "3:1,2,3=1,2,3"), "there are 2 clouds, and the first one stays"),
        ((ball, ball, "-o", stl, "--pair", "2:1,2,3"), "is no pair of places"),
        ((ball, ball, "-o", stl, "--pair", "2:1,2=1,2,3"), "'1,2' is no place"),
        ((ball, flat, "-o", stl), "empty.ply has points at 0 different places"),
        ((ball, ball, "-o", stl), "A cloud is named twice"),
        ((flat, "-o", flat), "empty.ply: the same command reads or writes it already"),
        ((ball, "-o", tmp_path / "b.ply", "--clean", tmp_path / "b.ply"), "reads or writes it already"),
        ((ball, "-o", stl, "--texture", 256), "--texture is for meshes that can have one"),
        ((tmp_path / "missing.ply", "-o", stl), "missing.ply"),
    ]
    for arguments, sentence in cases:
        ended = turnscan("surface", *arguments)
        assert ended.code == 2
        assert sentence in ended.sentence
    assert files_below(tmp_path) == {"empty.ply"}
