"""Things to scan."""

from pathlib import Path

import numpy as np
import pytest

from app.errors import OptionError
from app.simulation.objects import make_object, object_names, sphere


@pytest.mark.parametrize("name", object_names())
def test_an_object_stands_on_the_table_with_its_outside_out(name: str) -> None:
    mesh = make_object(name).mesh
    surface = mesh.as_trimesh()

    assert abs(float(mesh.vertices[:, 2].min())) < 0.5
    assert surface.volume > 0.0
    assert mesh.is_closed
    corners = mesh.vertices[mesh.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("fi,fi->f", across, mesh.normals[mesh.faces].mean(axis=1)) > 0.0).all()


@pytest.mark.parametrize("name", ["sphere", "cylinder", "cone"])
def test_triangles_that_stand_for_a_curve_lie_on_it(name: str) -> None:
    mesh = make_object(name, size_mm=80.0).mesh
    ends = np.concatenate([mesh.vertices, np.ones((len(mesh.vertices), 1))], axis=1)
    for number, quadric in enumerate(mesh.quadrics):
        used = np.unique(mesh.faces[mesh.face_quadric == number])
        value = np.einsum("ni,ij,nj->n", ends[used], quadric, ends[used])
        slope = 2.0 * np.linalg.norm(ends[used] @ quadric[:, :3], axis=1)
        assert float(np.abs(value[slope > 0.1] / slope[slope > 0.1]).max()) < 1e-6


def test_size_is_the_largest_extent() -> None:
    scaled = make_object("sphere", size_mm=100.0)

    assert np.ptp(scaled.mesh.vertices, axis=0).max() == pytest.approx(100.0)
    assert scaled.facts["radius_mm"] == pytest.approx(50.0)


def test_a_file_is_loaded_and_stood_on_the_table(tmp_path: Path) -> None:
    path = tmp_path / "ball.stl"
    sphere(20.0).mesh.as_trimesh().apply_translation([50.0, 0.0, 9.0]).export(path)
    loaded = make_object(str(path))

    assert loaded.name == "ball"
    assert loaded.mesh.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-5)
    assert loaded.mesh.vertices.mean(axis=0)[:2] == pytest.approx([0.0, 0.0], abs=0.05)
    assert loaded.mesh.is_closed


@pytest.mark.parametrize("data", [b"", b"solid nothing\nendsolid\n", b"\x00" * 90, b"not a mesh at all"])
def test_a_file_without_triangles_is_named(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "bad.stl"
    path.write_bytes(data)

    with pytest.raises(OptionError, match=r"bad\.stl"):
        make_object(str(path))


def test_a_missing_file_and_an_unknown_name_are_named(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match=r"missing\.ply"):
        make_object(str(tmp_path / "missing.ply"))
    with pytest.raises(OptionError, match="teapot"):
        make_object("teapot")


@pytest.mark.parametrize("size_mm", [0.0, -3.0, float("nan")])
def test_a_size_must_be_positive(size_mm: float) -> None:
    with pytest.raises(OptionError):
        make_object("cube", size_mm)
