"""Exported meshes and clouds, as other people's programs read them."""

import zipfile
from pathlib import Path

import laspy
import meshio
import numpy as np
import pytest
import trimesh
from clouds import some_cloud

from app.errors import OptionError, OutputError
from app.geometry.arrays import Floats
from app.geometry.mesh import TriangleMesh
from app.surface.exports.units import Unit
from app.surface.exports.write import CLOUD_SUFFIXES, MESH_SUFFIXES, write_cloud, write_mesh
from app.surface.ply_reader import read_ply

SIZE_MM = np.array([10.0, 20.0, 30.0])


@pytest.mark.parametrize("suffix", MESH_SUFFIXES)
def test_trimesh_reads_the_same_thing_in_every_form(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"box{suffix}"
    write_mesh(path, _box())
    scene = trimesh.load_scene(path)
    read = scene.to_mesh()
    # glTF is in metres, with y upwards.
    size = SIZE_MM[[0, 2, 1]] / 1000.0 if suffix == ".glb" else SIZE_MM
    assert len(read.faces) == 12
    assert read.is_watertight
    np.testing.assert_allclose(read.extents, size, rtol=1e-6)
    assert read.volume == pytest.approx(np.prod(size))
    if suffix in (".3mf", ".glb"):
        assert scene.units == {".3mf": "millimeter", ".glb": "meters"}[suffix]


@pytest.mark.parametrize("suffix", [".stl", ".ply", ".obj", ".off"])
def test_meshio_reads_the_same_thing(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"box{suffix}"
    write_mesh(path, _box())
    read = meshio.read(path)
    assert [(cells.type, len(cells.data)) for cells in read.cells] == [("triangle", 12)]
    np.testing.assert_allclose(np.ptp(read.points[:, :3], axis=0), SIZE_MM, rtol=1e-6)


@pytest.mark.parametrize("suffix", [".ply", ".obj"])
def test_colours_of_vertices_are_kept(tmp_path: Path, suffix: str) -> None:
    box = _box()
    path = tmp_path / f"box{suffix}"
    write_mesh(path, box)
    read = trimesh.load_mesh(path, process=False, maintain_order=True)
    np.testing.assert_array_equal(read.visual.vertex_colors[:, :3], box.colours)


def test_the_unit_is_in_the_file_where_it_can_be(tmp_path: Path) -> None:
    write_mesh(tmp_path / "box.3mf", _box(), Unit.INCH)
    with zipfile.ZipFile(tmp_path / "box.3mf") as archive:
        assert b'unit="inch"' in archive.read("3D/3dmodel.model")
    write_mesh(tmp_path / "box.stl", _box(), "cm")
    assert (tmp_path / "box.stl").read_bytes().startswith(b"Turnscan, unit cm")
    np.testing.assert_allclose(trimesh.load_mesh(tmp_path / "box.stl").extents, SIZE_MM / 10.0, rtol=1e-6)


@pytest.mark.parametrize("suffix", CLOUD_SUFFIXES)
def test_clouds_keep_places_and_colours(tmp_path: Path, suffix: str) -> None:
    cloud = some_cloud(500)
    path = tmp_path / f"cloud{suffix}"
    write_cloud(path, cloud)
    if suffix == ".ply":
        points: Floats = read_ply(path).points.astype(np.float64)
        colours: Floats = read_ply(path).colours.astype(np.float64)
    elif suffix == ".xyz":
        table = np.loadtxt(path)
        points, colours = table[:, :3], table[:, 3:]
    else:
        las = laspy.read(path)
        points, colours = las.xyz, np.column_stack([las.red, las.green, las.blue]) // 257
    np.testing.assert_allclose(points, cloud.points, atol=6e-4)
    np.testing.assert_array_equal(colours, cloud.colours)


def test_an_unknown_form_is_refused_with_those_there_are(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match=r"\.step") as mesh:
        write_mesh(tmp_path / "box.step", _box())
    with pytest.raises(OptionError, match=r"\.stl") as cloud:
        write_cloud(tmp_path / "cloud.stl", some_cloud(3))
    assert ".3mf" in mesh.value.hint
    assert ".laz" in cloud.value.hint


def test_a_file_is_whole_or_not_there(tmp_path: Path) -> None:
    with pytest.raises(OutputError):
        write_mesh(tmp_path / "missing" / "box.stl", _box())
    broken = TriangleMesh(_box().vertices, np.array([[0, 1, 99]], np.int32))
    with pytest.raises(IndexError):
        write_mesh(tmp_path / "box.stl", broken)
    assert list(tmp_path.iterdir()) == []


def _box() -> TriangleMesh:
    box = trimesh.creation.box(SIZE_MM)
    colours = np.random.default_rng(3).integers(0, 256, (len(box.vertices), 3), dtype=np.uint8)
    return TriangleMesh(box.vertices.astype(np.float32), box.faces.astype(np.int32), colours)
