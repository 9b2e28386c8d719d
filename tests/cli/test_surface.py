"""`turnscan surface` as a person runs it."""

from pathlib import Path

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
    ones = np.ones(len(points), np.float32)
    cloud = PointCloud(
        points.astype(np.float32), normals.astype(np.float32), np.full((len(points), 3), 90, np.uint8),
        0.02 * ones, np.zeros(len(points), np.uint8), 0.0 * ones, ones, ("left",),
    )  # fmt: skip
    path = tmp_path_factory.mktemp("clouds") / "ball.ply"
    write_ply(path, cloud.select(points[:, 2] > 2.0))
    return path


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


def test_half_a_ball_ends_with_a_doubt_and_open_without(ball: Path, tmp_path: Path) -> None:
    cloud = read_ply(ball)
    half = tmp_path / "half.ply"
    write_ply(half, cloud.select(cloud.points[:, 0] > 6.0))
    options = ("surface", half, "-o", tmp_path / "h.glb", "--no-steps", "--detail", 1.2)
    closed = turnscan(*options)
    assert closed.code == 1
    assert "is a guess" in closed.said
    assert turnscan(*options, "--open", "--holes", 3).code == 0


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
        ((tmp_path / "missing.ply", "-o", stl), "missing.ply"),
    ]
    for arguments, sentence in cases:
        ended = turnscan("surface", *arguments)
        assert ended.code == 2
        assert sentence in ended.sentence
    assert files_below(tmp_path) == {"empty.ply"}
