"""Exported meshes and clouds, as other people's programs read them."""

import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import laspy
import meshio
import numpy as np
import pytest
import trimesh
from clouds import some_cloud
from numpy.typing import NDArray

from app.errors import OptionError, OutputError, SurfaceError
from app.files import together
from app.geometry.arrays import Floats
from app.geometry.mesh import TriangleMesh
from app.surface.exports.units import Unit
from app.surface.exports.write import (
    CLOUD_SUFFIXES,
    MESH_SUFFIXES,
    TEXTURE_SUFFIXES,
    write_cloud,
    write_mesh,
)
from app.surface.ply_reader import read_ply
from app.surface.texture import paint_texture

_MATERIALS = "{http://schemas.microsoft.com/3dmanufacturing/material/2015/02}"
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


def test_a_3mf_has_the_colour_of_every_corner(tmp_path: Path) -> None:
    box = _box()
    assert box.colours is not None
    for colours, different in ((box.colours, 8), (np.full_like(box.colours, 90), 1)):
        write_mesh(tmp_path / "box.3mf", replace(box, colours=colours))
        with zipfile.ZipFile(tmp_path / "box.3mf") as archive:
            model = ET.fromstring(archive.read("3D/3dmodel.model"))
        shades = [shade.get("color") for shade in model.iter(f"{_MATERIALS}color")]
        assert len(shades) == len(set(shades)) == different
        thing = model.findall(".//{*}object")[0]
        assert thing.get("pid") == next(model.iter(f"{_MATERIALS}colorgroup")).get("id")
        for triangle, face in zip(model.findall(".//{*}triangle"), box.faces, strict=True):
            said = [shades[int(triangle.get(f"p{k}", thing.get("pindex", "")))] for k in (1, 2, 3)]
            assert said == ["#{:02X}{:02X}{:02X}FF".format(*colours[corner]) for corner in face]


@pytest.mark.parametrize("suffix", TEXTURE_SUFFIXES)
def test_a_texture_shows_what_is_finer_than_the_triangles(tmp_path: Path, suffix: str) -> None:
    # Red and blue alternate every five millimetres of height: the box has corners at its ends alone.
    box = _box()
    rng = np.random.default_rng(0)
    shares = rng.dirichlet(np.ones(3), 40_000)
    points = np.einsum("nk,nkc->nc", shares, box.corners()[rng.integers(0, len(box), len(shares))])
    cloud = some_cloud(len(points))
    colours = np.where(_is_red(points)[:, None], (255, 0, 0), (0, 0, 255)).astype(np.uint8)
    cloud = replace(cloud, points=points.astype(np.float32), colours=colours)
    told: list[float] = []
    texture = paint_texture(box, cloud, 600, told.append)
    assert max(texture.image.shape) <= 512
    assert told == sorted(told)
    assert told[-1] == 1.0
    path = tmp_path / f"a box{suffix}"
    write_mesh(path, box, texture=texture)
    beside = {each.name for each in tmp_path.iterdir()} - {path.name}
    assert beside == ({"a_box.mtl", "a_box-texture.png"} if suffix == ".obj" else set())
    read = trimesh.load_scene(path).to_mesh()
    assert len(read.faces) == 12
    picture = read.visual.material.image if suffix == ".obj" else read.visual.material.baseColorTexture
    shares = rng.dirichlet(np.ones(3), 400)
    which = rng.integers(0, 12, len(shares))
    asked = np.einsum("nk,nkc->nc", shares, read.triangles[which])
    height = asked[:, 2] if suffix == ".obj" else asked[:, 1] * 1000.0
    seen = trimesh.visual.color.uv_to_color(
        np.einsum("nk,nkc->nc", shares, read.visual.uv[read.faces[which]]), picture
    )
    is_clear = np.abs(height / 5.0 - np.round(height / 5.0)) > 0.15
    is_red = _is_red(np.column_stack([height, height, height]))[is_clear]
    assert np.mean((seen[is_clear, 0] > 128) == is_red) > 0.99


def _is_red(points: Floats) -> NDArray[np.bool_]:
    return np.asarray(np.floor(points[:, 2] / 5.0) % 2 == 0)


def test_a_texture_that_is_too_small_for_all_triangles_is_refused() -> None:
    ball = trimesh.creation.icosphere(subdivisions=5)
    mesh = TriangleMesh(ball.vertices.astype(np.float32), ball.faces.astype(np.int32))
    with pytest.raises(SurfaceError, match="20,480 triangles are too many for a texture of 64 pixels"):
        paint_texture(mesh, some_cloud(100), 64)


def test_a_cloud_that_is_kilometres_wide_fits_into_las(tmp_path: Path) -> None:
    cloud = some_cloud(10)
    cloud.points[0] = 5.0e6
    write_cloud(tmp_path / "wide.las", cloud)
    np.testing.assert_allclose(laspy.read(tmp_path / "wide.las").xyz, cloud.points, atol=0.01, rtol=1e-6)


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


def test_of_several_files_all_take_their_places_or_none(tmp_path: Path) -> None:
    stl, obj = tmp_path / "box.stl", tmp_path / "elsewhere" / "box.obj"
    obj.parent.mkdir()
    stl.write_text("an earlier one")
    too_deep = tmp_path / "box.stl" / "box.ply"
    with (
        pytest.raises(OutputError, match=r"box\.stl/box\.ply: not a directory"),
        together([stl, obj, too_deep]) as beside,
    ):
        write_mesh(beside[stl], _box())

    def write_and_lose_a_folder(beside: Mapping[Path, Path]) -> None:
        write_mesh(beside[stl], _box())
        beside[obj].parent.rmdir()
        write_mesh(beside[obj], _box())

    with pytest.raises(OutputError) as gone, together([stl, obj]) as beside:
        write_and_lose_a_folder(beside)
    assert gone.value.where == str(obj)
    assert stl.read_text() == "an earlier one"
    with together([stl, obj]) as beside:
        write_mesh(beside[obj], _box())
        write_mesh(beside[stl], _box())
        assert stl.read_text() == "an earlier one"
    assert len(trimesh.load_mesh(stl).faces) == len(trimesh.load_mesh(obj).faces) == 12
    assert {path.name for path in tmp_path.rglob("*")} == {"box.stl", "elsewhere", "box.obj"}


def _box() -> TriangleMesh:
    box = trimesh.creation.box(SIZE_MM)
    colours = np.random.default_rng(3).integers(0, 256, (len(box.vertices), 3), dtype=np.uint8)
    return TriangleMesh(box.vertices.astype(np.float32), box.faces.astype(np.int32), colours)
