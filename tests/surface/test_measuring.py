"""Sizes, fits and differences of shapes that are known."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from known_shapes import ball, cloud_of

from app.cli.main import run
from app.errors import OptionError, PointCloudFileError, SurfaceError
from app.geometry.cloud import PointCloud
from app.geometry.mesh import TriangleMesh
from app.surface.measure.deviation_map import deviation_map
from app.surface.measure.distance import span_between
from app.surface.measure.fits import FitKind, fit
from app.surface.measure.region import parse_region
from app.surface.measure.size import size_of_mesh, size_of_points
from app.surface.measure.thing import read_thing
from app.surface.ply import write_ply
from app.surface.ply_reader import read_ply

MIDDLE = np.array([0.0, 0.0, 30.0])


def test_a_third_of_points_elsewhere_does_not_move_a_fit() -> None:
    rng = np.random.default_rng(2)
    stray = rng.uniform(-40.0, 40.0, (5_000, 3)) + MIDDLE
    turn, along = rng.uniform(0, 2 * np.pi, 10_000), rng.uniform(-30.0, 30.0, 10_000)
    # A pipe of 12 mm, 30 degrees off upright, of which two thirds of the way round were seen.
    turn *= 2 / 3
    axis = np.array([0.5, 0.0, np.sqrt(0.75)])
    side = np.array([np.sqrt(0.75), 0.0, -0.5])
    noise = 0.03 * rng.normal(size=(10_000, 1))
    outward = np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * np.array([0.0, 1.0, 0.0])
    place = np.array([5.0, -3.0, 40.0])
    pipe = (12.0 + noise) * outward + along[:, None] * axis + place
    found = fit("cylinder", np.concatenate([pipe, stray]))
    assert found.radius_mm == pytest.approx(12.0, abs=0.005)
    assert abs(found.direction @ axis) > np.cos(np.radians(0.05))
    assert found.rms_mm == pytest.approx(0.03, abs=0.006)
    assert found.used == pytest.approx(10_000, rel=0.05)
    away = found.centre_mm - place
    assert np.linalg.norm(away - (away @ axis) * axis) < 0.01

    sphere = fit("sphere", np.concatenate([ball(10_000, 0.03).points, stray]))
    assert sphere.radius_mm == pytest.approx(20.0, abs=0.003)
    np.testing.assert_allclose(sphere.centre_mm, [0.0, 0.0, 30.0], atol=0.005)

    flat = np.column_stack([rng.uniform(-30, 30, (10_000, 2)), 7.0 + 0.03 * rng.normal(size=10_000)])
    plane = fit("plane", np.concatenate([flat, stray]))
    assert plane.direction[2] > np.cos(np.radians(0.02))
    assert plane.centre_mm[2] == pytest.approx(7.0, abs=0.01)
    assert plane.residuals[:10_000].std() == pytest.approx(0.03, rel=0.05)


@pytest.mark.parametrize("kind", ["plane", "sphere", "cylinder"])
def test_what_determines_no_shape_is_refused_in_plain_words(kind: FitKind) -> None:
    line = np.linspace(0.0, 1.0, 500)[:, None] * [1.0, 2.0, 3.0]
    for points in (np.zeros((0, 3)), np.full((50, 3), np.nan), np.ones((100_000, 3)), line):
        with pytest.raises(SurfaceError, match=f"{kind}"):
            fit(kind, points)


def test_sizes_of_a_turned_brick() -> None:
    brick = _brick((30.0, 20.0, 10.0), turned_deg=25.0)
    size = size_of_mesh(brick)
    np.testing.assert_allclose(size.smallest_mm, [30.0, 20.0, 10.0], atol=1e-4)
    assert size.turned_deg == pytest.approx(25.0, abs=1e-3)
    assert size.volume_mm3 == pytest.approx(6000.0, rel=1e-5)
    assert size.area_mm2 == pytest.approx(2200.0, rel=1e-5)
    assert (size.high_mm - size.low_mm)[0] > 30.0
    opened = TriangleMesh(brick.vertices, brick.faces[1:])
    assert size_of_mesh(opened).volume_mm3 is None
    line = size_of_points(np.array([[0.0, 0, 0], [3.0, 4.0, 0]]))
    np.testing.assert_allclose(line.smallest_mm, [5.0, 0.0, 0.0], atol=1e-9)
    with pytest.raises(SurfaceError, match="no points"):
        size_of_points(np.full((3, 3), np.nan))


def test_a_deviation_is_signed_exact_and_coloured() -> None:
    brick = _brick((30.0, 20.0, 10.0), turned_deg=0.0)
    points = np.array([[0, 0, 5.2], [0, 0, 4.7], [15.3, 0, 0], [18.0, 14.0, 0], [16.0, 11.0, 6.0], [0, 0, 0]])
    expected = [0.2, -0.3, 0.3, 5.0, np.sqrt(3.0), -5.0]
    found = deviation_map(cloud_of(points), brick, scale_mm=1.0)
    np.testing.assert_allclose(found.distances_mm, expected, atol=1e-5)
    outside, inside = found.cloud.colours[3], found.cloud.colours[5]
    assert outside[0] > 2 * outside[2]
    assert inside[2] > 2 * inside[0]
    assert found.counts.sum() == len(points)

    rng = np.random.default_rng(0)
    larger = rng.normal(size=(2_000, 3))
    larger *= 20.25 / np.linalg.norm(larger, axis=1, keepdims=True)
    signed = deviation_map(cloud_of(larger + MIDDLE), ball(40_000))
    assert signed.has_sign
    assert float(np.median(signed.distances_mm)) == pytest.approx(0.25, abs=0.01)
    bare = ball(40_000)
    unsigned = deviation_map(cloud_of(larger + MIDDLE), replace(bare, normals=np.zeros_like(bare.normals)))
    assert not unsigned.has_sign
    assert unsigned.distances_mm.min() >= 0.0
    with pytest.raises(SurfaceError, match="measure against"):
        deviation_map(cloud_of(points), PointCloud.empty())


def test_a_distance_runs_between_measured_places_and_regions_are_read() -> None:
    span = span_between(ball(40_000).points, np.array([30.0, 0, 30]), np.array([-21.0, 0, 30]))
    assert span.distance_mm == pytest.approx(40.0, abs=0.1)
    assert span.moved_mm == pytest.approx((10.0, 1.0), abs=0.1)
    assert len(parse_region("box:-50,-50,30,50,50,90").apply(ball(1_000))) < 600
    for wrong in ("box:1,2,3", "ball:1,2", "cylinder:-1,0,3", "box:a,b,c,d,e,f", ""):
        with pytest.raises(OptionError, match="does not describe a part"):
            parse_region(wrong)


def test_the_command_measures_compares_and_paints(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scan, model = tmp_path / "ball.ply", tmp_path / "model.stl"
    write_ply(scan, ball(20_000, 0.02))
    truth = trimesh.creation.icosphere(5, 20.0)
    truth.apply_translation([0, 0, 30])
    truth.export(model)
    coloured, picture = tmp_path / "coloured.ply", tmp_path / "picture.png"
    code = run(
        ["measure", str(scan), "--against", str(model), "--fit", "sphere", "--from", "20,0,30",
         "--to", "-20,0,30", "-o", str(coloured), "--picture", str(picture), "--json"]
    )  # fmt: skip
    told = json.loads(capsys.readouterr().out)
    assert code == 0
    assert told["fit"]["diameter_mm"] == pytest.approx(40.0, abs=0.01)
    assert told["deviation"]["rms_mm"] == pytest.approx(0.02, abs=0.01)
    assert told["distance"]["distance_mm"] == pytest.approx(40.0, abs=0.2)
    assert len(read_ply(coloured)) == 20_000
    assert cv2.imread(str(picture)) is not None
    assert run(["measure", str(model), "--region", "cylinder:15,0,100", "--fit", "plane"]) == 0
    assert "residual" in capsys.readouterr().err


def test_what_cannot_be_measured_is_told_in_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    empty, broken = tmp_path / "empty.ply", tmp_path / "broken.stl"
    write_ply(empty, PointCloud.empty())
    broken.write_bytes(b"solid nothing")
    for arguments, words in (
        ([empty], "has no points"),
        ([broken], "broken.stl"),
        ([tmp_path / "absent.ply"], "absent.ply"),
        ([empty, "--from", "1,2,3"], "both its ends"),
        ([empty, "--from", "1,2", "--to", "1,2,3"], "is no place"),
        ([empty, "-o", tmp_path / "x.ply"], "comparison"),
    ):
        assert run(["measure", *map(str, arguments)]) == 2
        assert words in " ".join(capsys.readouterr().err.split())
    with pytest.raises(PointCloudFileError):
        read_thing(broken)


def test_of_a_huge_cloud_an_even_choice_is_read(tmp_path: Path) -> None:
    path = tmp_path / "cloud.ply"
    cloud = ball(100_000)
    write_ply(path, cloud)
    read = read_thing(path, most=30_000)
    assert isinstance(read, PointCloud)
    np.testing.assert_array_equal(read.points, cloud.points[::4])


def _brick(sides: tuple[float, float, float], turned_deg: float) -> TriangleMesh:
    box = trimesh.creation.box(sides)
    box.apply_transform(trimesh.transformations.rotation_matrix(np.radians(turned_deg), [0, 0, 1]))
    return TriangleMesh(np.asarray(box.vertices, np.float32), np.asarray(box.faces, np.int32))
